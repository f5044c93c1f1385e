#include "server/api/board_answers.h"

#include <cstdint>
#include <memory>

#include "server/api/requests.h"

namespace myograde::server {

ApiResult BoardAnswers::Get(const httplib::Request& request) {
  absl::Status status = CheckParameters(request, BoardParametersAnd({}));
  if (!status.ok()) return ErrorOf(status);
  ApiAnswer answer{.tagged = true};
  status = context_.readers.Read([&](Reader& reader) -> absl::Status {
    const absl::StatusOr<BoardQuery> asked = ParseBoardQuery(request, reader, context_);
    if (!asked.ok()) return asked.status();
    const std::string& config = asked->track->config.hash;
    KeptBoards& kept = asked->at_ms == 0 && config == asked->config_in_force ? now_ : others_;
    const KeptBoards::Key key{config, asked->config_in_force, asked->board, asked->view(),
                              asked->at_ms};
    const int64_t changes = reader.BoardChanges();
    answer.text = kept.Find(key, changes);
    if (answer.text != nullptr) return absl::OkStatus();
    absl::StatusOr<std::string> text = make_(reader, *asked);
    if (!text.ok()) return text.status();
    answer.text = std::make_shared<const std::string>(*std::move(text));
    kept.Keep(key, changes, answer.text);
    return absl::OkStatus();
  });
  if (!status.ok()) return ErrorOf(status);
  return answer;
}

}  // namespace myograde::server
