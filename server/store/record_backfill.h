// Gives the rows of a store that had no record their entries. Internal to the store.
#pragma once

#include "server/store/connection.h"

namespace myograde::server {

// Appends an entry for each row that has one, in the order of time, with "backfilled": true; some
// thousands in a transaction, so that a killed one goes on where it stopped. Does nothing in a store
// that has been through it. Throws SQLite::Exception.
void BackfillRecord(SQLite::Database& db);

}  // namespace myograde::server
