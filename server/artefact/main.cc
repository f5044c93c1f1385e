// myograde-unpack: unpacks one upload for the daemon. It does nothing else, so that it starts
// quickly (unpack_process.h).
#include "server/artefact/unpack_process.h"

int main(int argc, char** argv) { return myograde::server::RunUnpackProcess(argc, argv); }
