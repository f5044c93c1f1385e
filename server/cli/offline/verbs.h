// The verbs that do their work on this host: most need no daemon. Each adds its options to `verb`
// and returns what it does.
#pragma once

#include <CLI/CLI.hpp>

#include "server/cli/base/exit_status.h"

namespace myograde::server {

Action AddServe(CLI::App& verb);
Action AddSubmit(CLI::App& verb);
Action AddExport(CLI::App& verb);
Action AddBackup(CLI::App& verb);
Action AddImport(CLI::App& verb);
Action AddPlot(CLI::App& verb);
Action AddRender(CLI::App& verb);
Action AddReplay(CLI::App& verb);
Action AddReport(CLI::App& verb);
Action AddVerify(CLI::App& verb);
Action AddChallenge(CLI::App& verb);
Action AddSeeds(CLI::App& verb);
Action AddRelease(CLI::App& verb);
Action AddLocal(CLI::App& verb);
Action AddTry(CLI::App& verb);
Action AddNew(CLI::App& verb);
Action AddRuntime(CLI::App& verb);
Action AddSpec(CLI::App& verb);
Action AddDoctor(CLI::App& verb);

}  // namespace myograde::server
