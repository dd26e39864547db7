/* Takes the place of libc's ptrace in user-mode Linux (LD_PRELOAD), which before Linux 6.13 writes floating-point
 * registers of a fixed size. The host accepts the size of all its registers only, and AMX makes them larger: EFAULT.
 * Here the whole state is read first, a shorter state replaces its beginning, and the whole state is written back.
 * No header and no library is needed to compile it: the functions that it calls are in the program that loads it. */

struct part {
    void *base;
    unsigned long length;
};

extern long syscall(long number, ...);
extern void *memcpy(void *to, const void *from, unsigned long length);

enum { SYS_PTRACE = 101, PEEK_FIRST = 1, PEEK_LAST = 3, GETREGSET = 0x4204, SETREGSET = 0x4205, X86_XSTATE = 0x202 };

/* not on the stack, which is a small one; nothing else of the one-processor kernel runs between read and write */
static _Alignas(64) char whole_state[65536];

long ptrace(long request, long pid, void *address, void *data)
{
    struct part *given = data;
    struct part whole = {whole_state, sizeof whole_state};
    long word, result;

    if (request >= PEEK_FIRST && request <= PEEK_LAST) {
        result = syscall(SYS_PTRACE, request, pid, address, &word);
        return result < 0 ? result : word;
    }
    if (request == SETREGSET && (long)address == X86_XSTATE
        && syscall(SYS_PTRACE, GETREGSET, pid, address, &whole) == 0 && given->length < whole.length) {
        memcpy(whole_state, given->base, given->length);
        return syscall(SYS_PTRACE, SETREGSET, pid, address, &whole);
    }
    return syscall(SYS_PTRACE, request, pid, address, data);
}
