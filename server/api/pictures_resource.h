// Episodes to look at: trajectories, small pictures, and the shapes of the tracks' bodies.
#pragma once

#include <optional>
#include <string>

#include "server/api/context.h"
#include "server/api/routes.h"
#include "server/pictures/pictures.h"

namespace myograde::server {

// Safe from any thread.
class PicturesResource {
 public:
  // `context` must outlive it.
  explicit PicturesResource(const ApiContext& context) : context_(context) {}

  void Install(Routes& routes);

 private:
  absl::Status SendTrajectory(const Request& request, Response& response) const;
  absl::Status SendPicture(const Request& request, Response& response) const;
  absl::Status SendModel(const Request& request, Response& response) const;
  absl::Status SendOfLog(PictureKind kind, const char* type,
                                    const Request& request,
                                    Response& response) const;
  // The file, or how far it is.
  absl::Status Send(const PictureKey& key, const char* type,
                               const Request& request, Response& response) const;

  const ApiContext& context_;
};

}  // namespace myograde::server
