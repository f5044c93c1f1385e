#include "server/api/board_answers.h"

#include <cstdint>
#include <memory>

#include "protocol/base/status_macros.h"
#include "server/api/phase_sight.h"
#include "server/api/requests.h"

namespace myograde::server {

absl::StatusOr<std::shared_ptr<const std::string>> BoardAnswers::TextOf(Reader& reader,
                                                                        const BoardQuery& asked) {
  const std::string& config = asked.track->config.hash;
  KeptBoards& kept = asked.at_ms == 0 && config == asked.config_in_force ? now_ : others_;
  const KeptBoards::Key key{config, asked.config_in_force, asked.board, asked.view(), asked.at_ms};
  const int64_t changes = reader.BoardChanges();
  if (auto found = kept.Find(key, changes); found != nullptr) return found;
  ASSIGN_OR_RETURN(std::string made, make_(reader, asked));
  auto text = std::make_shared<const std::string>(std::move(made));
  kept.Keep(key, changes, text);
  return text;
}

ApiResult BoardAnswers::Get(const Request& request) {
  RETURN_IF_ERROR(CheckParameters(request, BoardParametersAnd({})));
  ApiAnswer answer{.tagged = true};
  RETURN_IF_ERROR(context_.readers.Read([&](Reader& reader) -> absl::Status {
    ASSIGN_OR_RETURN(const BoardQuery asked, ParseBoardQuery(request, reader, context_));
    ASSIGN_OR_RETURN(answer.text, TextOf(reader, asked));
    ASSIGN_OR_RETURN(answer.for_all_origins,
                     IsPhasePublic(reader, context_, asked.track->config.phase));
    return absl::OkStatus();
  }));
  return answer;
}

}  // namespace myograde::server
