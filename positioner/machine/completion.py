"""Completion of a command line by the shell alone: `--completion SHELL` prints what the shell needs for it. Shell.

No key starts Python. The one value that no list holds, the name of a valve, the shell reads from the configuration.
"""

from __future__ import annotations

import argparse
import re
import sys
import zlib
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

SHELLS = ("bash", "zsh", "fish")
_FILES = {"config": "*.toml", "picture": "*.png", "report": "*.html", "trace": "*.csv"}
"""Which files an option takes, where its metavar is only FILE."""
_READ_IDS = r"""sed -nE 's/^[[:space:]]*(valve\.)?id[[:space:]]*=[[:space:]]*"([^"]+)".*/\2/p'"""
_VALVES = {
    "bash": f"""
  local number file
  for ((number = 1; number < COMP_CWORD; number++)); do
    [[ ${{COMP_WORDS[number]}} == --config ]] || continue
    file=${{COMP_WORDS[number + 1]}}
    compgen -W "$({_READ_IDS} "${{file/#\\~/$HOME}}" 2>/dev/null)" -- "$1"
  done""",
    "zsh": f"""
  compadd -- ${{(f)"$({_READ_IDS} ${{~words[${{words[(i)--config]}} + 1]}} 2>/dev/null)"}}""",
    "fish": f"""
  set -l words (commandline -opc)
  if set -l place (contains -i -- --config $words)
    {_READ_IDS} (string replace -r '^~' $HOME -- $words[(math $place + 1)]) 2>/dev/null
  end""",
}
_WITHOUT_EQUALS = """

# bash makes three words of --option=value
{function}_joined() {{
  local index last=$COMP_CWORD words=()
  for index in "${{!COMP_WORDS[@]}}"; do
    if [[ ${{COMP_WORDS[index]}} != = ]]; then words+=("${{COMP_WORDS[index]}}")
    elif ((index == COMP_CWORD)); then words+=("")
    elif ((index < COMP_CWORD)); then ((last -= 1))
    fi
  done
  local COMP_WORDS=("${{words[@]}}") COMP_CWORD=$last
  {function} "$@"
}}
complete -o bashdefault -F {function}_joined {program}"""
_SUGGESTED = {
    "bash": """
  compgen -P "${{1%"${{1##*,}}"}}" -W '{names}' -- "${{1##*,}}"
  for pattern in {patterns}; do compgen -f -X "!$pattern" -- "$1"; compgen -d -- "$1"; done""",
    "zsh": """
  compset -P '*,'
  compadd -- {names}
  for pattern in {patterns}; do _files -g "$pattern"; done""",
    "fish": """
  printf '%s\\n' {names}
  for pattern in {patterns}; __fish_complete_suffix (string sub -s 2 -- $pattern); end""",
}


class Completion(argparse.Action):
    """Prints the completion for a shell, and ends the program."""

    def __init__(self, option_strings: Sequence[str], dest: str) -> None:
        text = "print what this shell needs to complete command lines"
        super().__init__(option_strings, dest, choices=SHELLS, help=text)

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,  # noqa: ARG002 - argparse gives it
        values: str | Sequence[Any] | None,
        option_string: str | None = None,  # noqa: ARG002 - argparse gives it
    ) -> None:
        """Print it."""
        sys.stdout.write(f"{completion(parser, str(values))}\n")
        parser.exit()


def suggest(action: argparse.Action, names: Callable[[], Iterable[str]], *patterns: str) -> None:
    """Let a shell offer `names` for a value that may be another one: a list with commas, or a file like a pattern."""
    action.suggested = names, patterns  # type: ignore[attr-defined] # for `_offer`


def completion(parser: argparse.ArgumentParser, shell: str) -> str:
    """Return what `shell` needs to complete the command lines of a program; `parser` has all of its commands."""
    import shtab  # noqa: PLC0415 - nothing else needs it

    for action in _actions(parser):
        if not action.choices and (offer := _offer(action)):
            action.complete = offer  # type: ignore[attr-defined] # for shtab
    script = str(shtab.complete(parser, shell))
    if shell == "bash":
        script += _WITHOUT_EQUALS.format(function=re.sub(r"\W", "_", f"_shtab_{parser.prog}"), program=parser.prog)
    return script


def _actions(parser: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    for action in parser._actions:  # noqa: SLF001 - argparse shows them nowhere else
        yield action
        if isinstance(action, argparse._SubParsersAction):  # noqa: SLF001 - argparse names no type
            for below in action.choices.values():
                yield from _actions(below)


def _offer(action: argparse.Action) -> Any:
    """Return what shtab is told of the value of an option or argument, None for nothing."""
    import shtab  # noqa: PLC0415 - nothing else needs it

    metavar = action.metavar if isinstance(action.metavar, str) else ""
    names, patterns = getattr(action, "suggested", None) or _in_metavar(metavar)
    if action.dest == "valve":
        return _function("valves", _VALVES)
    if names:
        filled = {"names": " ".join(names()), "patterns": " ".join(f"'{each}'" for each in patterns)}
        return _function(
            f"file_{zlib.crc32(repr(filled).encode()):08x}",
            {shell: text.format(**filled) for shell, text in _SUGGESTED.items()},
        )
    if metavar == "DIR":
        return shtab.DIRECTORY
    suffix = re.search(r"\.[a-z]+$", metavar)
    if pattern := f"*{suffix[0]}" if suffix else _FILES.get(action.dest):
        # zsh would take the brackets that shtab puts around a single pattern for qualifiers
        return {**shtab.glob(pattern), "zsh": f"_files -g '{pattern}'"}
    return shtab.FILE if action.type is Path else None


def _in_metavar(metavar: str) -> tuple[Callable[[], Iterable[str]] | None, Sequence[str]]:
    """Return the words and the patterns of files that a metavar like `ramp|step|FILE.csv` lists itself."""
    parts = metavar.split("|") if "|" in metavar else []
    words = tuple(part for part in parts if part.islower())
    suffixes = [re.fullmatch(r"FILE(\.[a-z]+)", part) for part in parts]
    return (lambda: words) if words else None, tuple(f"*{each[1]}" for each in suffixes if each)


def _function(name: str, bodies: dict[str, str]) -> dict[str, Any]:
    """Return what shtab is told of a value that a function of the shell completes."""
    called = f"_positioner_{name}"
    defined = {shell: f"{called}() {{{body}\n}}" for shell, body in bodies.items()}
    defined["fish"] = f"function {called}{bodies['fish']}\nend"
    return {"bash": called, "zsh": called, "fish": f"({called})", "preamble": defined}
