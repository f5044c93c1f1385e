#include "server/api/api.h"

#include "server/api/routes.h"

namespace myograde::server {

void Api::Install(UnixHttpServer& server) {
  Routes routes(server);
  host_.Install(routes);
  artefacts_.Install(routes);
  submissions_.Install(routes);
  evaluations_.Install(routes);
  boards_.Install(routes);
  quota_.Install(routes);
  proof_.Install(routes);
  transfer_.Install(routes);
  whoami_.Install(routes);
  routes.AddErrorAnswers();
}

}  // namespace myograde::server
