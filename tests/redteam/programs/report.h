// Shared by the hostile programs in C: prints findings as lines "RT NAME RESULT" on standard error,
// and then becomes an honest policy, so that the suite sees that the attempt changed nothing.
#pragma once


#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

// `result` below 0: denied with errno.
static inline void Report(const char* name, long result) {
  const char* error = strerrorname_np(errno);
  fprintf(stderr, "RT %s %s\n", name, result >= 0 ? "allowed" : error != NULL ? error : "unknown");
}

static inline void ReportText(const char* name, const char* text) {
  fprintf(stderr, "RT %s %s\n", name, text);
}

static inline void BecomeHonest(void) {
  char* const arguments[] = {"/usr/bin/python3", "honest.py", NULL};
  execv(arguments[0], arguments);
  abort();
}
