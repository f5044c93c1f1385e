// myograde-unpack: unpacks one upload for the daemon. It does nothing else, so that it starts
// quickly (unpack_process.h).
#include <cstdio>

#include "server/artefact/unpack_process.h"

int main(int argc, char** argv) {
  int status = 2;
  if (!myograde::server::RunUnpackProcess(argc, argv, status)) {
    std::fputs("error: myograde-unpack is started by myograded only; submit with myograde submit\n",
               stderr);
  }
  return status;
}
