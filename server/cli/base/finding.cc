#include "server/cli/base/finding.h"

#include <algorithm>
#include <iostream>

#include <absl/strings/str_cat.h>

#include "server/cli/terminal/table.h"
#include "server/cli/terminal/text.h"

namespace myograde::server {

bool HasFinding(const std::vector<Finding>& findings, FindingState state) {
  return std::any_of(findings.begin(), findings.end(),
                     [&](const Finding& finding) { return finding.state == state; });
}

FindingState WorstOf(const std::vector<Finding>& findings) {
  FindingState worst = FindingState::kOk;
  for (const Finding& finding : findings) worst = std::max(worst, finding.state);
  return worst;
}

const char* FindingStateName(FindingState state) {
  switch (state) {
    case FindingState::kOk:
      return "ok";
    case FindingState::kWarning:
      return "warning";
    case FindingState::kUnknown:
      return "unknown";
    case FindingState::kFails:
      return "fails";
  }
  return "unknown";
}

Json FindingsJson(const std::vector<Finding>& findings) {
  Json list = Json::array();
  for (const Finding& finding : findings) {
    list.push_back({{"name", finding.check},
                    {"state", FindingStateName(finding.state)},
                    {"found", finding.found},
                    {"todo", finding.todo}});
  }
  return list;
}

void PrintFindings(const std::vector<Finding>& findings) {
  PrintRows(FindingsJson(findings), {"check=name", "state", "found"});
  for (const FindingState state :
       {FindingState::kFails, FindingState::kUnknown, FindingState::kWarning}) {
    for (const Finding& finding : findings) {
      if (finding.state != state || finding.todo.empty()) continue;
      std::cout << Bold(absl::StrCat(finding.check, ": ", FindingStateName(state))) << ": "
                << Harmless(finding.todo) << '\n';
    }
  }
}

}  // namespace myograde::server
