// myograde submit: the request to a daemon (../client/submit.h), or the dry run of it on this host.
#include <memory>

#include "server/cli/client/submit.h"
#include "server/cli/offline/dry_run.h"
#include "server/cli/offline/verbs.h"

namespace myograde::server {

Action AddSubmit(CLI::App& verb) {
  auto options = std::make_shared<DryRunOptions>();
  CLI::Option* wait = AddSubmitOptions(verb, *options);
  verb.add_flag("--dry-run", options->dry_run,
                "Send nothing: check the submission, ask the server whether it would accept it, "
                "play one practice episode here with all limits on, and say what would fail (its "
                "JSON: configs/schema/submit-dry-run.json)")
      ->excludes(wait);
  AddHostOptions(verb, options->host);
  return [options] { return options->dry_run ? DryRun(*options) : Submit(*options); };
}

}  // namespace myograde::server
