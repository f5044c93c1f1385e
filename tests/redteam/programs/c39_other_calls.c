// System calls through the entry points of 32-bit and x32 programs, from a 64-bit one, and a 32-bit
// program of its own. Each is tried in a child, since a kernel without that entry point kills it.
#include "report.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/wait.h>

enum { kPassed = 42 };

// mkdir by the numbers of 32-bit x86 and of x32: its effect shows whether it worked.
static long LegacyMkdir(const char* path) {
  // Such a call sees only the lower half of an address.
  char* low = mmap(NULL, 4096, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_32BIT,
                   -1, 0);
  if (low == MAP_FAILED) return -1;
  strcpy(low, path);
  long result;
  __asm__ volatile("int $0x80"
                   : "=a"(result)
                   : "a"(39), "b"(low), "c"(0700)
                   : "memory", "r8", "r9", "r10", "r11");
  return result;
}

static long LegacyPid(const char* unused) {
  (void)unused;
  long result;
  __asm__ volatile("int $0x80" : "=a"(result) : "a"(20) : "memory", "r8", "r9", "r10", "r11");
  return result;
}

static long X32Pid(const char* unused) {
  (void)unused;
  return syscall(0x40000000 | SYS_getpid);
}

static long X32Mkdir(const char* path) { return syscall(0x40000000 | SYS_mkdir, path, 0700); }

static void InChild(const char* name, long (*call)(const char*), const char* path) {
  const pid_t child = fork();
  if (child == 0) {
    const long result = call(path);
    _exit(result >= 0 ? kPassed : 0);
  }
  int status = 0;
  waitpid(child, &status, 0);
  if (WIFSIGNALED(status)) {
    ReportText(name, "killed");  // no such entry point, or no return from it
  } else {
    ReportText(name, WEXITSTATUS(status) == kPassed ? "allowed" : "EPERM");
  }
}

// The smallest static ELF program of 32-bit x86: exit(42), then an invalid instruction.
static const unsigned char kProgram[] = {
    0x7f, 'E', 'L', 'F', 1, 1, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0,            // 32 bits, little-endian
    2, 0, 3, 0, 1, 0, 0, 0, 0x54, 0x80, 0x04, 0x08, 52, 0, 0, 0,        // executable, i386, entry
    0, 0, 0, 0, 0, 0, 0, 0, 52, 0, 32, 0, 1, 0, 0, 0, 0, 0, 0, 0,       // one program header
    1, 0, 0, 0, 0, 0, 0, 0, 0, 0x80, 0x04, 0x08, 0, 0x80, 0x04, 0x08,   // load at 0x8048000
    0x62, 0, 0, 0, 0x62, 0, 0, 0, 5, 0, 0, 0, 0, 0x10, 0, 0,            // 98 bytes, r-x
    0xb8, 1, 0, 0, 0, 0xbb, kPassed, 0, 0, 0, 0xcd, 0x80, 0x0f, 0x0b,   // exit(42), ud2
};

static long Legacy32Program(const char* path) {
  const int fd = open(path, O_CREAT | O_WRONLY | O_CLOEXEC, 0700);
  if (write(fd, kProgram, sizeof(kProgram)) != sizeof(kProgram)) return -1;
  close(fd);
  execl(path, path, (char*)NULL);
  return -1;
}

int main(void) {
  static const char kFolder[] = "/tmp/by-legacy-call";
  InChild("legacy_getpid", LegacyPid, NULL);
  InChild("legacy_mkdir", LegacyMkdir, kFolder);
  InChild("x32_getpid", X32Pid, NULL);
  InChild("x32_mkdir", X32Mkdir, "/tmp/by-x32-call");
  InChild("program32", Legacy32Program, "/tmp/program32");
  struct stat seen;
  Report("folder_made", stat(kFolder, &seen) == 0 || stat("/tmp/by-x32-call", &seen) == 0 ? 0 : -1);
  BecomeHonest();
}
