"""A bare Debian 12 of one's own: a folder that packages are installed into, then a machine with its own
kernel and systemd that boots from it. The machine is emulated (qemu), so it needs no hardware for
virtual machines, and nothing of the host's control groups or settings shows in it."""

import pathlib
import shutil
import subprocess

TOOLS = ("mmdebstrap", "mke2fs", "qemu-system-x86_64")
PACKAGES = ("ca-certificates", "dbus", "initramfs-tools", "iproute2", "kmod", "linux-image-cloud-amd64",
            "procps", "systemd-sysv", "udev")
# Its standard output is the second serial line; the machine is switched off at its end.
UNIT = """[Unit]
After=multi-user.target
[Service]
Type=oneshot
TimeoutStartSec=infinity
StandardOutput=tty
StandardError=tty
TTYPath=/dev/ttyS1
Environment=HOME=/root DEBIAN_FRONTEND=noninteractive LC_ALL=C.UTF-8
ExecStart=/bin/bash /root/trial.sh
ExecStopPost=/bin/systemctl poweroff --no-block
[Install]
WantedBy=default.target
"""
MOUNT = """set -e
mount --make-rprivate /
root=$1; shift
mount -t proc proc "$root/proc"; mount --rbind /sys "$root/sys"; mount --rbind /dev "$root/dev"
exec chroot "$root" "$@"
"""


def run(*words, timeout=900, **options):
    """What the command writes; AssertionError with its last words if it fails."""
    done = subprocess.run([str(word) for word in words], capture_output=True, text=True, timeout=timeout,
                          stdin=subprocess.DEVNULL, errors="replace", **options)
    if done.returncode != 0:
        raise AssertionError(f"{words}: exit {done.returncode}\n{done.stdout[-3000:]}{done.stderr[-3000:]}")
    return done.stdout


def lacking():
    """The tools that are not installed."""
    return [tool for tool in TOOLS if not shutil.which(tool)]


class Machine:
    def __init__(self, folder, base=None):
        """`base` may name an archive of such a system, which saves the download of its packages."""
        self.root = pathlib.Path(folder) / "root"
        self.disk = pathlib.Path(folder) / "disk"
        self.folder = pathlib.Path(folder)
        if base:
            self.root.mkdir()
            run("tar", "-C", self.root, "-xf", base)
        else:
            run("mmdebstrap", "--variant=minbase", f"--include={','.join(PACKAGES)}", "bookworm", self.root)
        shutil.copy("/etc/resolv.conf", self.root / "etc/resolv.conf")

    def inside(self, *words, timeout=900):
        """Runs a command as root in the folder, with this host's network and kernel."""
        return run("unshare", "--mount", "--pid", "--fork", "--kill-child", "sh", "-c", MOUNT, "sh", self.root,
                   *words, timeout=timeout,
                   env={"PATH": "/usr/sbin:/usr/bin:/sbin:/bin", "HOME": "/root", "LC_ALL": "C.UTF-8",
                        "DEBIAN_FRONTEND": "noninteractive"})

    def trust(self):
        """What reaches registries from this host does from there."""
        shutil.copy("/etc/ssl/certs/ca-certificates.crt", self.root / "etc/ssl/certs/ca-certificates.crt")
        if pathlib.Path("/etc/pip.conf").exists():
            shutil.copy("/etc/pip.conf", self.root / "etc/pip.conf")

    def boot(self, script, deadline_s, memory_mib=3072):
        """Boots, runs the script as root, and returns what it and the kernel wrote."""
        (self.root / "root/trial.sh").write_text(script)
        unit = self.root / "etc/systemd/system/trial.service"
        unit.write_text(UNIT)
        wants = unit.parent / "default.target.wants"
        wants.mkdir(exist_ok=True)
        (wants / unit.name).symlink_to("../trial.service")
        (self.root / "etc/fstab").write_text("/dev/vda / ext4 defaults 0 1\n")
        used = int(run("du", "-sxk", self.root).split()[0])
        self.disk.unlink(missing_ok=True)
        run("mke2fs", "-q", "-t", "ext4", "-d", self.root, self.disk, f"{used * 5 // 4 + (2 << 20)}k")
        kernel, = (self.root / "boot").glob("vmlinuz-*")
        initrd, = (self.root / "boot").glob("initrd.img-*")
        told, console = self.folder / "told", self.folder / "console"
        machine = ["qemu-system-x86_64", "-accel", "tcg,thread=multi", "-cpu", "max", "-smp", "2",
                   "-m", str(memory_mib), "-display", "none", "-monitor", "none", "-nic", "none", "-no-reboot",
                   "-kernel", kernel, "-initrd", initrd,
                   "-append", "root=/dev/vda rw console=ttyS0 panic=-1 systemd.show_status=no",
                   "-drive", f"file={self.disk},format=raw,if=virtio,cache=unsafe",
                   "-serial", f"file:{console}", "-serial", f"file:{told}"]
        try:
            run(*machine, timeout=deadline_s)
        except subprocess.TimeoutExpired:
            pass  # what it told says how far it came
        return (told.read_text(errors="replace").replace("\r", ""),
                console.read_text(errors="replace").replace("\r", ""))
