#include "damaged_store.h"

#include <filesystem>

#include <SQLiteCpp/SQLiteCpp.h>
#include <absl/strings/str_cat.h>

#include "server/engine/stored.h"
#include "server/grading/leaderboard.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;

void RunFor(World& world, absl::Duration time) {
  const absl::Duration until = world.clock.Monotonic() + time;
  while (world.clock.Monotonic() < until) world.RunOnce();
}

void Require(const absl::Status& status) {
  if (!status.ok()) throw std::runtime_error(std::string(status.message()));
}

}  // namespace

std::string BoardText(ReaderPool& readers, const std::string& config) {
  std::string text;
  Require(readers.Read([&](const Transaction& reader) -> absl::Status {
    StoredContent content;
    const absl::StatusOr<TrackPtr> track = content.Track(reader, config);
    if (!track.ok()) {
      text = std::string(track.status().message());
      return ExtractDamage(track.status()) ? absl::OkStatus() : track.status();
    }
    const BoardState& state = reader.Board();
    std::vector<StandingRow> rows;
    std::vector<Damage> damaged;
    for (StandingRow& row : state.Candidates(config)) {
      const absl::StatusOr<nlohmann::json> standing = ReadStanding(reader, row.evaluation);
      if (!standing.ok() && !ExtractDamage(standing.status())) return standing.status();
      if (!standing.ok()) damaged.push_back(*ExtractDamage(standing.status()));
      row.aggregate = standing.value_or(nullptr);
      rows.push_back(std::move(row));
    }
    const absl::StatusOr<Leaderboard> board =
        MakeLeaderboard(rows, state.MarksAt(),
                        (*track)->scoring.boards.at(scoring::kMainBoard).rules,
                        (*track)->scoring);
    if (!board.ok()) return board.status();
    for (const LeaderboardRow& row : board->rows) {
      absl::StrAppend(&text, row.ranked.rank, " ", row.source.team, " ", row.source.submission, " ",
                      row.source.aggregate.dump(), "\n");
    }
    for (const Damage& damage : damaged) absl::StrAppend(&text, DamageText(damage), "\n");
    return absl::OkStatus();
  }));
  return text;
}

TwoTeams MakeTwoTeams(const std::string& folder) {
  TwoTeams teams;
  teams.store = folder + "/two-teams.db";
  World world(folder + "/world", {}, 2);
  world.JumpClock(absl::Hours(24 * 20'000));
  const TrackConfig config = world.track->config;
  const auto play = [&](TwoTeams::Team& team, const std::string& name, uint64_t first_seed) {
    world.track = *MakeTrack(*WithSeeds(config, {first_seed, first_seed + 1, first_seed + 2}));
    team.config = world.track->config.hash;
    team.done = world.Submit(name, 6);
    RunFor(world, absl::Minutes(1));
  };
  play(teams.victim, "victim", 100);
  play(teams.other, "other", 200);
  world.track = *MakeTrack(*WithSeeds(config, {100, 101, 102}));
  teams.victim.open = world.Submit("victim", 4);
  world.track = *MakeTrack(*WithSeeds(config, {200, 201, 202}));
  teams.other.open = world.Submit("other", 4);
  teams.other.queued = world.Submit("other", 2);  // both slots are taken
  RunFor(world, absl::Seconds(7));  // each has an episode and a running lease
  Require(world.store->Write([&](Transaction& writer) -> absl::Status {
    absl::Status status = writer.quotas.Grant({"victim", world.track->config.id, Budget::kRanked, 1,
                                        "the grid was down"}, "uid 0");
    status.Update(writer.journal.Mark(1, "baseline", true, "uid 0", "ours").status());
    status.Update(writer.content.Remove("log", std::string(64, 'f'), 10, "too old").status());
    status.Update(writer.teams.SetMember("victim", "uid 1001", true, "uid 0").status());
    status.Update(writer.teams.SetMember("other", "uid 1002", true, "uid 0").status());
    for (const char* name : {"former", "victim"}) {
      status.Update(writer.teams.Rename("victim", name, "uid 0", "").status());
    }
    status.Update(writer.callers.AddToken(std::string(64, 'a'),
        {.role = "participant", .team = "victim", .label = "laptop"}, "uid 0").status());
    status.Update(writer.callers.AddToken(std::string(64, 'b'),
        {.role = "participant", .team = "other", .label = "laptop"}, "uid 0").status());
    return status;
  }));
  if (!world.broken.empty()) throw std::runtime_error(world.broken);
  teams.victim.board = BoardText(*world.readers, teams.victim.config);
  teams.other.board = BoardText(*world.readers, teams.other.config);
  world.Cut();
  SQLite::Database db(folder + "/world/store.db", SQLite::OPEN_READWRITE);
  db.exec(absl::StrCat("INSERT INTO replay VALUES (1, ", teams.victim.done,
                       ", 0, 2, '[\"digest\"]', '{}', 6)"));
  db.exec("PRAGMA journal_mode = DELETE");
  fs::copy_file(folder + "/world/store.db", teams.store, fs::copy_options::overwrite_existing);
  return teams;
}

std::vector<Target> TargetsIn(const TwoTeams& teams) {
  const std::string done = absl::StrCat(teams.victim.done), open = absl::StrCat(teams.victim.open);
  const auto of = [](const std::string& evaluation, const char* column) {
    return absl::StrCat("(SELECT s.", column, " FROM submission AS s JOIN evaluation AS e ON ",
                        "e.submission = s.id WHERE e.id = ", evaluation, ")");
  };
  std::vector<std::pair<std::string, std::string>> rows = {
      {"meta", "key = 'team_skeletons'"},
      {"team_skeleton",
       "team = (SELECT id FROM team WHERE name = 'victim') AND skeleton = (SELECT min(skeleton) "
       "FROM team_skeleton WHERE team = (SELECT id FROM team WHERE name = 'victim'))"},
      {"team", "name = 'victim'"},
      {"team_name", "name = 'former'"},
      {"journal", "id = 1"},
      {"journal", "evaluation = " + done},
      {"journal", "kind = 'marked'"},
      {"member", "person = 'uid 1001'"},
      {"token", "id = 1"},
      {"config", absl::StrCat("hash = '", teams.victim.config, "'")},
      {"removal", "id = 1"},
      {"ledger", "entry = 'grant'"},
      {"replay", "id = 1"},
      {"standing", "evaluation = " + done},
      {"block", absl::StrCat("id = (SELECT min(id) FROM block WHERE evaluation = ", open,
                             " AND state = 'pending')")},
      {"block", absl::StrCat("id = (SELECT min(id) FROM block WHERE evaluation = ", open,
                             " AND state = 'running')")},
      {"block", absl::StrCat("id = (SELECT min(id) FROM block WHERE evaluation = ", done, ")")}};
  for (const std::string& evaluation : {done, open}) {
    rows.emplace_back("artefact", "hash = " + of(evaluation, "artefact"));
    rows.emplace_back("seed_list", "hash = " + of(evaluation, "seeds"));
    rows.emplace_back("submission", "id = " + of(evaluation, "id"));
    rows.emplace_back("ledger", "submission = " + of(evaluation, "id"));
    rows.emplace_back("evaluation", "id = " + evaluation);
    rows.emplace_back("episode", absl::StrCat("evaluation = ", evaluation, " AND idx = 0"));
    rows.emplace_back("episode_details",
                      absl::StrCat("evaluation = ", evaluation, " AND idx = 0"));
    rows.emplace_back("transition",
                      absl::StrCat("id = (SELECT max(id) FROM transition WHERE entity = "
                                   "'evaluation' AND entity_id = ",
                                   evaluation, ")"));
  }
  std::vector<Target> targets;
  SQLite::Database db(teams.store);
  for (const auto& [table, where] : rows) {
    SQLite::Statement columns(db, "SELECT name FROM pragma_table_info(?) WHERE NOT (pk = 1 AND "
                                  "type = 'INTEGER' AND ?1 != 'episode')");
    columns.bind(1, table);
    while (columns.executeStep()) {
      targets.push_back({table, where, columns.getColumn(0).getString()});
    }
  }
  return targets;
}

bool Overwrite(const std::string& store, const Target& target, const std::string& value) {
  const auto with_schema = [&](const std::string& sql) {
    SQLite::Database db(store, SQLite::OPEN_READWRITE);
    db.exec("PRAGMA writable_schema = ON");
    db.exec(sql);
  };
  // Types and NOT NULL are part of the table's SQL text; triggers and checks can be left out.
  std::vector<std::pair<std::string, std::string>> triggers;
  std::string text;
  {
    SQLite::Database db(store);
    SQLite::Statement names(db, "SELECT name, sql FROM sqlite_schema WHERE type = 'trigger'");
    while (names.executeStep()) {
      triggers.emplace_back(names.getColumn(0).getString(), names.getColumn(1).getString());
    }
    SQLite::Statement table(db, "SELECT sql FROM sqlite_schema WHERE type = 'table' AND name = ?");
    table.bind(1, target.table);
    if (!table.executeStep()) return false;
    text = table.getColumn(0).getString();
  }
  const auto set_text = [&](const std::string& to) {
    SQLite::Database db(store, SQLite::OPEN_READWRITE);
    db.exec("PRAGMA writable_schema = ON");
    SQLite::Statement update(db,
                             "UPDATE sqlite_schema SET sql = ? WHERE type = 'table' AND name = ?");
    update.bind(1, to);
    update.bind(2, target.table);
    update.exec();
  };
  with_schema(
      absl::StrCat("UPDATE sqlite_schema SET sql = replace(replace(sql, ') STRICT, ', ') '), ",
                   "') STRICT', ')') WHERE type = 'table' AND name = '", target.table, "'"));
  with_schema(
      absl::StrCat("UPDATE sqlite_schema SET sql = replace(replace(replace(sql, 'IS NOT NULL'",
                   ", 'IS_NOT_NULL'), ' NOT NULL', ''), 'IS_NOT_NULL', 'IS NOT NULL') WHERE ",
                   "type = 'table' AND name = '", target.table, "'"));
  bool written = false;
  {
    SQLite::Database db(store, SQLite::OPEN_READWRITE);
    db.exec("PRAGMA ignore_check_constraints = ON");
    for (const auto& [name, sql] : triggers) db.exec("DROP TRIGGER " + name);
    try {
      written = db.exec(absl::StrCat("UPDATE ", target.table, " SET ", target.column, " = ", value,
                                     " WHERE ", target.where)) == 1;
    } catch (const SQLite::Exception&) {  // a duplicate key
    }
    for (const auto& [name, sql] : triggers) db.exec(sql);
  }
  set_text(text);
  return written;
}

}  // namespace myograde::server
