// Makes every system call that reaches beyond a sandbox, by number, and reports each result.
#include "report.h"

#include <linux/keyctl.h>
#include <linux/perf_event.h>
#include <linux/sched.h>
#include <sched.h>
#include <signal.h>
#include <sys/ioctl.h>
#include <sys/mount.h>
#include <sys/ptrace.h>
#include <sys/reboot.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <sys/wait.h>

#define TRY(name, ...) Report(#name, syscall(SYS_##name, __VA_ARGS__))

static char buffer[256];

static void OtherProcesses(void) {
  const pid_t parent = getppid();
  struct iovec local = {buffer, sizeof(buffer)};
  Report("ptrace_attach", syscall(SYS_ptrace, PTRACE_ATTACH, parent, 0, 0));
  Report("ptrace_seize", syscall(SYS_ptrace, PTRACE_SEIZE, parent, 0, 0));
  TRY(process_vm_readv, parent, &local, 1, &local, 1, 0);
  TRY(process_vm_writev, parent, &local, 1, &local, 1, 0);
  const int first = (int)syscall(SYS_pidfd_open, parent, 0);
  Report("pidfd_getfd", syscall(SYS_pidfd_getfd, first, 3, 0));
  TRY(process_madvise, first, &local, 1, 21, 0);
  TRY(kcmp, parent, getpid(), 0, 0, 0);
  TRY(move_pages, parent, 0, NULL, NULL, NULL, 0);
}

static void KernelParts(void) {
  TRY(bpf, 0, buffer, sizeof(buffer));
  struct perf_event_attr event = {.type = PERF_TYPE_SOFTWARE, .size = sizeof(event)};
  TRY(perf_event_open, &event, 0, -1, -1, 0);
  TRY(userfaultfd, 0);
  TRY(io_uring_setup, 8, buffer);
  TRY(io_uring_enter, -1, 0, 0, 0, NULL, 0);
  TRY(io_uring_register, -1, 0, NULL, 0);
  TRY(add_key, "user", "redteam", "x", 1, KEY_SPEC_SESSION_KEYRING);
  TRY(request_key, "user", "redteam", NULL, 0);
  TRY(keyctl, KEYCTL_GET_KEYRING_ID, KEY_SPEC_USER_KEYRING, 1);
  TRY(kexec_load, 0, 0, NULL, 0);
  TRY(kexec_file_load, -1, -1, 0, "", 0);
  TRY(init_module, buffer, 1, "");
  TRY(finit_module, -1, "", 0);
  TRY(delete_module, "none", 0);
  TRY(syslog, 3, buffer, sizeof(buffer));
  TRY(fanotify_init, 0, 0);
  TRY(quotactl, 0, NULL, 0, NULL);
  TRY(acct, "/tmp/acct");
  TRY(iopl, 3);
  TRY(ioperm, 0x80, 1, 1);
  TRY(swapon, "/tmp/none", 0);
  TRY(swapoff, "/tmp/none");
}

static void MountsAndNames(void) {
  TRY(mount, "none", "/tmp", "tmpfs", 0, "");
  TRY(umount2, "/tmp", MNT_DETACH);
  TRY(pivot_root, "/tmp", "/tmp");
  TRY(chroot, "/tmp");
  TRY(fsopen, "tmpfs", 0);
  TRY(open_tree, -100, "/tmp", 1);
  TRY(move_mount, -1, "", -1, "", 0);
  TRY(mount_setattr, -1, "", 0, NULL, 0);
  TRY(name_to_handle_at, -100, "/", buffer, buffer, 0);
  TRY(open_by_handle_at, -100, buffer, 0);
  TRY(sethostname, "owned", 5);
  TRY(setdomainname, "owned", 5);
  TRY(settimeofday, NULL, NULL);
  TRY(clock_settime, 0, buffer);
  TRY(clock_adjtime, 0, buffer);
  TRY(vhangup, 0);
  Report("reboot", syscall(SYS_reboot, 0xfee1dead, 672274793, RB_DISABLE_CAD, NULL));
}

static void Namespaces(void) {
  TRY(setns, -1, 0);
  Report("unshare_user", syscall(SYS_unshare, CLONE_NEWUSER));
  Report("unshare_net", syscall(SYS_unshare, CLONE_NEWNET));
  Report("unshare_mount", syscall(SYS_unshare, CLONE_NEWNS));
  const long child = syscall(SYS_clone, CLONE_NEWUSER | SIGCHLD, 0, 0, 0, 0);
  if (child == 0) _exit(0);
  Report("clone_user", child);
  if (child > 0) waitpid((pid_t)child, NULL, 0);
  struct clone_args wanted = {.flags = CLONE_NEWUSER, .exit_signal = SIGCHLD};
  const long third = syscall(SYS_clone3, &wanted, sizeof(wanted));
  if (third == 0) _exit(0);
  Report("clone3", third);
  char letter = 'x';
  Report("terminal_input", ioctl(0, TIOCSTI, &letter));
}

int main(void) {
  OtherProcesses();
  KernelParts();
  MountsAndNames();
  Namespaces();
  BecomeHonest();
}
