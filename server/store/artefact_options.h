// The column artefact.options_json: a key for each wish of a policy.json that is not the default.
#pragma once

#include <string>

#include "server/store/rows.h"
#include "server/store/stored_row.h"

namespace myograde::server {

// Canonical JSON.
std::string ArtefactOptionsOf(const ArtefactRow& artefact);

// The reverse. What is not understood is damage of the row.
void ReadArtefactOptions(StoredRow& row, int column, ArtefactRow& artefact);

}  // namespace myograde::server
