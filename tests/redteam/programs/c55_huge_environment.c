// A child executes itself twenty times with as large an environment as the kernel accepts.
#include <sys/wait.h>

#include "report.h"

enum { kRounds = 20, kWords = 15, kLength = 127 << 10 };

static void BecomeLarge(char* self, int round) {
  static char word[kLength + 1];
  memset(word, 'x', kLength);
  word[1] = '=';
  char* environment[kWords + 1];
  for (int i = 0; i < kWords; ++i) environment[i] = word;
  environment[kWords] = NULL;
  char number[16];
  snprintf(number, sizeof(number), "%d", round);
  char* const arguments[] = {self, number, NULL};
  execve("/proc/self/exe", arguments, environment);
  _exit(1);
}

int main(int argc, char** argv) {
  const int round = argc == 2 ? atoi(argv[1]) : 0;
  if (round == kRounds) return 0;
  if (round > 0) BecomeLarge(argv[0], round + 1);
  const pid_t child = fork();
  if (child == 0) BecomeLarge(argv[0], 1);
  int status = 0;
  waitpid(child, &status, 0);
  ReportText("rounds", WIFEXITED(status) && WEXITSTATUS(status) == 0 ? "made" : "refused");
  BecomeHonest();
}
