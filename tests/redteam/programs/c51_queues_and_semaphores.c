// System V message queues and semaphores, as many as it gets, all left behind.
#include <sys/ipc.h>
#include <sys/msg.h>
#include <sys/sem.h>

#include "report.h"

int main(void) {
  struct {
    long type;
    char text[8000];
  } message = {1, {0}};
  int queues = 0;
  for (; queues < 100000; ++queues) {
    const int id = msgget(IPC_PRIVATE, IPC_CREAT | 0666);
    if (id < 0) break;
    while (msgsnd(id, &message, sizeof(message.text), IPC_NOWAIT) == 0) continue;
  }
  Report("more_queues", queues < 100000 ? -1 : 0);
  int sets = 0;
  while (sets < 100000 && semget(IPC_PRIVATE, 100, IPC_CREAT | 0666) >= 0) ++sets;
  Report("more_semaphores", sets < 100000 ? -1 : 0);
  BecomeHonest();
}
