// The verbs that speak to a daemon. Each adds its options to `verb` and returns what it does.
#pragma once

#include <CLI/CLI.hpp>

#include "server/cli/base/exit_status.h"

namespace myograde::server {

Action AddStatus(CLI::App& verb);
Action AddCancel(CLI::App& verb);
Action AddChoose(CLI::App& verb);
Action AddPhase(CLI::App& verb);
Action AddLeaderboard(CLI::App& verb);
Action AddShow(CLI::App& verb);
Action AddRerun(CLI::App& verb);
Action AddRejudge(CLI::App& verb);
Action AddEvaluate(CLI::App& verb);
Action AddQuota(CLI::App& verb);
Action AddHide(CLI::App& verb);
Action AddUnhide(CLI::App& verb);
Action AddDisqualify(CLI::App& verb);
Action AddBaseline(CLI::App& verb);
Action AddEvents(CLI::App& verb);
Action AddLog(CLI::App& verb);
Action AddReceipt(CLI::App& verb);
Action AddRecord(CLI::App& verb);
Action AddKey(CLI::App& verb);
Action AddTeam(CLI::App& verb);
Action AddToken(CLI::App& verb);
Action AddLogin(CLI::App& verb);
Action AddLogout(CLI::App& verb);
Action AddCluster(CLI::App& verb);
Action AddWebhook(CLI::App& verb);
Action AddWhoami(CLI::App& verb);

}  // namespace myograde::server
