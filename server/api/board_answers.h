// Answers about boards that were made already, until the store changes.
#pragma once

#include <cstddef>
#include <functional>
#include <memory>
#include <string>
#include <utility>

#include <absl/status/statusor.h>

#include "server/api/board_query.h"
#include "server/api/context.h"
#include "server/api/kept_boards.h"
#include "server/api/routes.h"

namespace myograde::server {

// Safe from any thread.
class BoardAnswers {
 public:
  // What is said of a board, as the text of the answer.
  using Make = std::function<absl::StatusOr<std::string>(Reader& reader, const BoardQuery& asked)>;

  // `context` must outlive it.
  BoardAnswers(const ApiContext& context, Make make) : context_(context), make_(std::move(make)) {}

  // The answer about the board that a request asks for; its parameters are BoardParametersAnd({}).
  ApiResult Get(const Request& request);
  // The text of that answer.
  absl::StatusOr<std::shared_ptr<const std::string>> TextOf(Reader& reader,
                                                            const BoardQuery& asked);

 private:
  const ApiContext& context_;
  const Make make_;
  // Apart, as boards of the past are asked for without end.
  KeptBoards now_{256, size_t{256} << 20};
  KeptBoards others_{32, size_t{32} << 20};
};

}  // namespace myograde::server
