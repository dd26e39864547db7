"""systemd as process 1, with a target of our own: the units that the tests need, and the tests."""

BOOT = """mkdir -p /run/systemd/system
cat > /run/systemd/system/kernel-tests.service <<END
[Unit]
Description=Tests inside this kernel
[Service]
Type=oneshot
TimeoutStartSec=infinity
StandardOutput=append:{out}/pytest.log
StandardError=inherit
ExecStart=/bin/sh {out}/inside
ExecStopPost=/bin/busybox poweroff -f
END
cat > /run/systemd/system/kernel-tests.target <<END
[Unit]
Description=What the tests need, and the tests
Requires=basic.target
Wants=kernel-tests.service
After=basic.target
AllowIsolate=yes
END
for unit in systemd-timesyncd.service systemd-resolved.service systemd-firstboot.service \\
    ldconfig.service systemd-hwdb-update.service systemd-journal-catalog-update.service \\
    systemd-update-utmp.service systemd-machine-id-commit.service systemd-random-seed.service \\
    systemd-pstore.service systemd-tmpfiles-setup.service systemd-tmpfiles-setup-dev.service tmp.mount \\
    systemd-tmpfiles-clean.timer systemd-binfmt.service dev-hugepages.mount dev-mqueue.mount \\
    sys-kernel-debug.mount sys-kernel-tracing.mount; do
    ln -s /dev/null /run/systemd/system/$unit
done
rm -f /etc/fstab /etc/machine-id /etc/systemd/system/*.target.wants/*
echo 0123456789abcdef0123456789abcdef > /etc/machine-id
: > /etc/fstab
exec /lib/systemd/systemd systemd.unit=kernel-tests.target systemd.log_level=notice systemd.show_status=false
"""
"""Shell commands; `out` is the folder of the kernel's script and results."""
