// The column artefact.options_json: what a policy.json says beyond name, command, runtimes and env.
// Internal to the store.
#pragma once

#include <string>

#include "server/store/rows.h"
#include "server/store/stored_row.h"

namespace myograde::server {

// A canonical JSON object of what differs from its default.
std::string ArtefactOptionsText(const ArtefactRow& artefact);

// The reverse. An unknown key fails `row`: whoever stored it knew what it changes.
void ReadArtefactOptions(StoredRow& row, int column, ArtefactRow& artefact);

}  // namespace myograde::server
