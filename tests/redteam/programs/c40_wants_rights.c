// Requests more privileges: setuid programs of the host and of its own, capabilities, other users.
#include "report.h"

#include <fcntl.h>
#include <linux/capability.h>
#include <sys/prctl.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/wait.h>

// Runs a program, and reports "allowed" if it exits with status 0, as "who" does for root.
static void RunOther(const char* name, const char* const* arguments) {
  const pid_t child = fork();
  if (child == 0) {
    const int nothing = open("/dev/null", O_RDWR);
    dup2(nothing, 0);
    dup2(nothing, 1);
    dup2(nothing, 2);
    execv(arguments[0], (char* const*)arguments);
    _exit(126);
  }
  int status = 0;
  waitpid(child, &status, 0);
  ReportText(name, WIFEXITED(status) && WEXITSTATUS(status) == 0 ? "allowed" : "EPERM");
}

static void StatusLine(const char* key, const char* name) {
  FILE* file = fopen("/proc/self/status", "r");
  char line[256];
  while (file != NULL && fgets(line, sizeof(line), file) != NULL) {
    if (strncmp(line, key, strlen(key)) != 0 || line[strlen(key)] != ':') continue;
    line[strcspn(line, "\n")] = 0;
    ReportText(name, line + strlen(key) + strspn(line + strlen(key), ":\t "));
  }
  if (file != NULL) fclose(file);
}

// Runs a copy of this program with the setuid bit: it must still be the same user.
static void OwnSetuid(const char* self) {
  const char* const copy[] = {"/bin/cp", self, "/tmp/setuid", NULL};
  RunOther("copy", copy);
  Report("chmod_setuid_root", chown("/tmp/setuid", 0, 0));
  Report("chmod_setuid", chmod("/tmp/setuid", 06755) == 0 ? 0 : -1);
  const char* const again[] = {"/tmp/setuid", "who", NULL};
  RunOther("setuid_copy", again);
}

int main(int argc, char** argv) {
  if (argc == 2 && strcmp(argv[1], "who") == 0) return geteuid() == 0 ? 0 : 1;
  StatusLine("NoNewPrivs", "no_new_privs");
  StatusLine("CapEff", "effective");
  StatusLine("CapPrm", "permitted");
  StatusLine("CapBnd", "bounding");
  StatusLine("CapAmb", "ambient");
  StatusLine("Seccomp", "seccomp");
  Report("setuid_0", setuid(0));
  Report("setgid_0", setgid(0));
  Report("setreuid_0", setreuid(0, 0));
  Report("setuid_host", setuid(1));
  struct __user_cap_header_struct head = {_LINUX_CAPABILITY_VERSION_3, 0};
  struct __user_cap_data_struct all[2] = {{~0u, ~0u, ~0u}, {~0u, ~0u, ~0u}};
  Report("capset", syscall(SYS_capset, &head, all));
  Report("ambient_raise", prctl(PR_CAP_AMBIENT, PR_CAP_AMBIENT_RAISE, CAP_SYS_ADMIN, 0, 0));
  Report("no_new_privs_off", prctl(PR_SET_NO_NEW_PRIVS, 0, 0, 0, 0));
  Report("seccomp_off", prctl(PR_SET_SECCOMP, 0, NULL, 0, 0));
  const char* const sudo[] = {"/usr/bin/sudo", "-n", "true", NULL};
  const char* const su[] = {"/usr/bin/su", "-c", "true", NULL};
  const char* const mount[] = {"/usr/bin/mount", "-t", "tmpfs", "none", "/tmp", NULL};
  RunOther("sudo", sudo);
  RunOther("su", su);
  RunOther("mount", mount);
  OwnSetuid(argv[0]);
  BecomeHonest();
}
