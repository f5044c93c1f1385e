-- The store of a MyoGrade daemon, version 1 (PRAGMA user_version). A change of it is a further file
-- beside this one, applied after it in a transaction of its own (connection.h).
--
-- Content never changes and is found by its hash:
--   artefact         what was submitted (its files lie in DATA/artefacts/HASH)
--   config           the effective track config of one profile
--   seed_list        the seeds of an evaluation, in the order of play
--   upload           artefacts whose files lie here and that no submission has asked for: whose they
--                    are, and since when. A submission takes its artefact's row away, and so does the
--                    removal of the files
--   artefact_holder  who uploaded an artefact's files, and for which team ('': for none). A team may
--                    submit an artefact that it holds or submitted before, and nobody else may
-- Teams, and who calls:
--   team             may have been merged into another one, and may be banned
--   team_name        the names that a team has or had, so that each finds it
--   team_skeleton        what a team's name looks like (server/base/names.h): names that share a look can be
--                    taken for one another. Made again when the rule for it changes
--   member           who belongs to a team; the newest row of a team and a person is in force
--   token            bearer tokens, as hashes
--   access_event     requests that were denied, and acts of organisers and operators. Denied requests
--                    that are equal share a row for a day, and go after some time; acts stay
--   request_key      submissions and re-runs that were asked for with an Idempotency-Key
-- What happens:
--   submission       a team asks for an artefact to be graded; its id is the acceptance number
--   evaluation       one playing of it: the original, a re-run of some of its blocks, or of a rejudge: its
--                    result under that one's config and seeds, computed from the facts of its source or
--                    played. Of several repetitions the first one counts
--   block            a block of consecutive episodes of an evaluation, played by one policy process
--   episode          one row for each episode played: the facts, and what scoring made of them
--   episode_details  what pages and reports show of it besides (protocol/README.md). No result follows
--                    from it; an episode without a step has none. A table of its own, as a row of
--                    `episode` with it would not fit into a page
--   replay           an episode of a repeated block that came out otherwise than its row
--   transition       every change of state: when, from, to, who, why
--   attempt          one playing of a block that has ended: on which node and as which job ('' on the
--                    daemon's own host), what it used, and how it ended. One that a daemon did not live
--                    to see the end of has no row. CPU time and energy are whole numbers of a thousandth,
--                    as exports hold nothing else
--   node_event       a node of the cluster gets no more blocks, or gets them again. The newest row of a
--                    node is in force
-- Acts:
--   journal          every act that decides what stands on a board or that the public record tells, in
--                    order (server/board/acts.h): its public keys, which are an entry of the record, and
--                    the private ones. `chain` is the SHA-256 over the digits of the entry before ('' for
--                    the first), a line feed and the entry. What follows from the journal is computed by
--                    server/board, and by no query
-- Quotas and files:
--   ledger           every charge, refund and grant of a team's quota
--   removal          files that were removed from the data folder, by the organiser's policy
-- Phases:
--   phase_secret     what the seeds of a phase with committed seeds follow from
-- What others are told:
--   delivery         what webhooks are told, until they have taken it
-- Boards, which can be dropped and made again at any time:
--   standing         what a finished evaluation is ranked by: a view of its episode rows
--
-- States, and the function of Store that makes each step (anything else is refused by CHECK, by
-- trigger, or by the store's own comparison with the state before):
--
--   block        pending --StartBlock--> running --FinishBlock--> done
--                   ^                      |  |
--                   +-----ReturnBlock------+  +--------EndBlock----> failed | cancelled
--                   +--------------------EndBlock------------------> cancelled
--
--   evaluation   queued --StartBlock (first)--> running --EndEvaluation--> done | failed |
--                   |                                                    cancelled | grader_error
--                   +---------EndEvaluation---> cancelled | grader_error
--
-- Invariants:
--    1. (evaluation, idx) is the key of an episode: it counts once, however often played.
--    2. An episode's identity and facts, audit rows and content rows are never changed or deleted.
--    3. A running block has a slot, an owner, a start and a deadline; a block that does not run has
--       no slot and no deadline.
--    4. A submission has exactly one original evaluation (inserted in the same transaction).
--    5. The blocks of an evaluation do not overlap and cover [first, last].
--    6. Every change of a state inserts its transition in the same transaction.
--    7. A submission is charged once in each budget, and each charge is refunded at most once.
--    8. The journal and the ledger are never changed or deleted, nor is what a submission is charged by.
--    9. A day is the number of whole days since 1970-01-01 UTC: the clock's, or the day after if the
--       submissions or the ledger have rows of that already.
--   10. Memberships and access events (but for their count, and denials that are old) are never changed
--       or deleted.
--   11. A phase's secret is never changed.
--   12. The entries of the public record are numbered 0, 1, 2 and so on.
--   13. An evaluation has a rejudge if and only if it is of that kind.
--   14. Neither attempts nor node events are ever changed or
--       deleted.
--
-- Times are milliseconds since 1970-01-01 UTC: for people, and never for an order or a decision.
-- Booleans are 0 and 1. Text columns named *_json hold canonical JSON.

-- "MyGr": how a store is told from other databases.
PRAGMA application_id = 0x4d794772;

-- The store itself.

CREATE TABLE meta (
  key   TEXT PRIMARY KEY,
  value BLOB NOT NULL            -- such as 'home': the folder that the store belongs to
) STRICT;

-- Content.

CREATE TABLE artefact (
  hash          TEXT PRIMARY KEY CHECK (length(hash) = 64),
  name          TEXT NOT NULL,   -- as its policy.json says
  manifest_json TEXT NOT NULL,   -- the whole of it (protocol/lease/policy_image.h)
  bytes         INTEGER NOT NULL CHECK (bytes >= 0),
  files         INTEGER NOT NULL CHECK (files >= 0),
  created_at    INTEGER NOT NULL
) STRICT;

CREATE TABLE config (
  hash         TEXT PRIMARY KEY CHECK (length(hash) = 64),
  content_json TEXT NOT NULL
) STRICT;

CREATE TABLE seed_list (
  hash         TEXT PRIMARY KEY CHECK (length(hash) = 64),
  content_json TEXT NOT NULL
) STRICT;

CREATE TABLE upload (
  artefact TEXT PRIMARY KEY REFERENCES artefact (hash),
  uploader TEXT NOT NULL,                -- as 'uid 1000'; '' is not known
  team     TEXT NOT NULL,                -- '' is not known
  at       INTEGER NOT NULL
) STRICT;

CREATE TABLE artefact_holder (
  artefact TEXT NOT NULL REFERENCES artefact (hash),
  uploader TEXT NOT NULL,
  team     TEXT NOT NULL,
  PRIMARY KEY (artefact, uploader, team)
) STRICT, WITHOUT ROWID;

CREATE INDEX upload_by_uploader ON upload (uploader);
CREATE INDEX upload_by_team ON upload (team);
CREATE TRIGGER artefact_fixed BEFORE UPDATE ON artefact
  BEGIN SELECT RAISE(ABORT, 'an artefact is never changed'); END;
CREATE TRIGGER config_fixed BEFORE UPDATE ON config
  BEGIN SELECT RAISE(ABORT, 'a config is never changed'); END;
CREATE TRIGGER seed_list_fixed BEFORE UPDATE ON seed_list
  BEGIN SELECT RAISE(ABORT, 'a seed list is never changed'); END;

-- Teams and callers.

CREATE TABLE team (
  id          INTEGER PRIMARY KEY,
  name        TEXT NOT NULL UNIQUE CHECK (length(name) > 0),
  created_at  INTEGER NOT NULL,
  merged_into INTEGER REFERENCES team (id),
  banned      INTEGER NOT NULL DEFAULT 0 CHECK (banned IN (0, 1))
) STRICT;

CREATE TABLE team_name (
  name    TEXT PRIMARY KEY CHECK (length(name) > 0),
  team_id INTEGER NOT NULL REFERENCES team (id)
) STRICT;

CREATE TABLE team_skeleton (
  skeleton TEXT NOT NULL,
  team INTEGER NOT NULL REFERENCES team (id),
  PRIMARY KEY (skeleton, team)
) STRICT, WITHOUT ROWID;

CREATE TABLE member (
  id      INTEGER PRIMARY KEY AUTOINCREMENT,
  at      INTEGER NOT NULL,
  team_id INTEGER NOT NULL REFERENCES team (id),
  person  TEXT NOT NULL CHECK (length(person) > 0),   -- 'uid 1000'
  belongs INTEGER NOT NULL CHECK (belongs IN (0, 1)),
  who     TEXT NOT NULL CHECK (length(who) > 0)
) STRICT;

CREATE TABLE token (
  id           INTEGER PRIMARY KEY AUTOINCREMENT,
  hash         TEXT NOT NULL UNIQUE CHECK (length(hash) = 64),   -- SHA-256 of the token's text
  role         TEXT NOT NULL CHECK (role IN ('participant', 'organiser', 'operator')),
  team_id      INTEGER REFERENCES team (id),
  label        TEXT NOT NULL,
  created_at   INTEGER NOT NULL,
  created_by   TEXT NOT NULL CHECK (length(created_by) > 0),
  expires_at   INTEGER,                  -- NULL: never
  revoked_at   INTEGER,
  revoked_by   TEXT,
  last_used_at INTEGER,                  -- to the minute
  CHECK ((role = 'participant') = (team_id IS NOT NULL)),
  CHECK ((revoked_at IS NULL) = (revoked_by IS NULL))
) STRICT;

CREATE TABLE access_event (
  id      INTEGER PRIMARY KEY AUTOINCREMENT,
  at      INTEGER NOT NULL,
  kind    TEXT NOT NULL CHECK (kind IN ('denied', 'act')),
  who     TEXT NOT NULL CHECK (length(who) > 0),  -- 'uid 1000', 'token 7', 'address 192.0.2.1'
  role    TEXT NOT NULL,
  action  TEXT NOT NULL CHECK (length(action) > 0),
  subject TEXT NOT NULL,           -- what it was about; '' where that would be a stranger's text
  detail  TEXT NOT NULL,                 -- why it was denied, or what the act changed
  count   INTEGER NOT NULL DEFAULT 1 CHECK (count > 0)
) STRICT;

CREATE TABLE request_key (
  who        TEXT NOT NULL,
  key        TEXT NOT NULL,
  request    TEXT NOT NULL CHECK (length(request) = 64),   -- SHA-256 of what was asked for
  submission INTEGER NOT NULL REFERENCES submission (id),
  evaluation INTEGER NOT NULL REFERENCES evaluation (id),
  linked     INTEGER NOT NULL CHECK (linked IN (0, 1)),
  at         INTEGER NOT NULL,
  PRIMARY KEY (who, key)
) STRICT, WITHOUT ROWID;

CREATE INDEX team_by_merge ON team (merged_into) WHERE merged_into NOT NULL;
CREATE INDEX team_name_by_team ON team_name (team_id);
CREATE INDEX team_skeleton_by_team ON team_skeleton (team);
CREATE INDEX member_by_team ON member (team_id, person, id);
CREATE INDEX member_by_person ON member (person, team_id, id);
CREATE INDEX request_key_by_age ON request_key (at);
CREATE INDEX request_key_by_caller ON request_key (who, at DESC, key);
CREATE INDEX access_event_by_age ON access_event (kind, at);
CREATE TRIGGER member_fixed BEFORE UPDATE ON member
  BEGIN SELECT RAISE(ABORT, 'memberships are never changed'); END;
CREATE TRIGGER member_kept BEFORE DELETE ON member
  BEGIN SELECT RAISE(ABORT, 'memberships are never deleted'); END;
CREATE TRIGGER access_event_fixed
  BEFORE UPDATE OF at, kind, who, role, action, subject, detail ON access_event
  BEGIN SELECT RAISE(ABORT, 'access events are never changed'); END;
CREATE TRIGGER access_event_kept BEFORE DELETE ON access_event WHEN OLD.kind = 'act'
  BEGIN SELECT RAISE(ABORT, 'acts are never deleted'); END;

-- Submissions and their evaluations.

CREATE TABLE submission (
  id          INTEGER PRIMARY KEY AUTOINCREMENT,
  team_id     INTEGER NOT NULL REFERENCES team (id),
  artefact    TEXT NOT NULL REFERENCES artefact (hash),
  track       TEXT NOT NULL,
  profile     TEXT NOT NULL,
  config      TEXT NOT NULL REFERENCES config (hash),
  seeds       TEXT NOT NULL REFERENCES seed_list (hash),
  ranked      INTEGER NOT NULL CHECK (ranked IN (0, 1)),  -- plays exactly the config's seeds
  accepted_by TEXT NOT NULL,
  accepted_at INTEGER NOT NULL,
  day         INTEGER NOT NULL CHECK (day >= 0),  -- whose quota it is charged to
  phase       TEXT NOT NULL DEFAULT '',  -- of a challenge; '': the track's own board
  -- Its policy is shown those of its track: it asked for them, and its profile allowed it.
  extra_observations INTEGER NOT NULL DEFAULT 0 CHECK (extra_observations IN (0, 1))
) STRICT;

CREATE TABLE evaluation (
  id           INTEGER PRIMARY KEY AUTOINCREMENT,
  submission   INTEGER NOT NULL REFERENCES submission (id),
  kind         TEXT NOT NULL CHECK (kind IN ('original', 'rerun', 'rejudge')),
  first        INTEGER NOT NULL CHECK (first >= 0),
  last         INTEGER NOT NULL CHECK (last >= first),
  state        TEXT NOT NULL CHECK (state IN
                 ('queued', 'running', 'done', 'failed', 'cancelled', 'grader_error')),
  reason       TEXT NOT NULL DEFAULT '',      -- why it ended without a score
  grader_json  TEXT NOT NULL,                 -- the build that plays it
  results_hash TEXT,                          -- over the canonical rows, once it ended
  created_at   INTEGER NOT NULL,
  started_at   INTEGER,
  finished_at  INTEGER,
  config       TEXT REFERENCES config (hash),     -- of a rejudge; NULL: the submission's
  seeds        TEXT REFERENCES seed_list (hash),  -- the same
  rejudge      INTEGER,                           -- its number in the journal; NULL: of none
  repetition   INTEGER CHECK (repetition >= 1),   -- of a rejudge that plays several times
  source       INTEGER REFERENCES evaluation (id),  -- that it is the new result of
  method       TEXT CHECK (method IN ('facts', 'play')),
  CHECK ((kind = 'rejudge') = (rejudge IS NOT NULL)),
  CHECK ((rejudge IS NULL) = (repetition IS NULL) AND (rejudge IS NULL) = (source IS NULL) AND
         (rejudge IS NULL) = (method IS NULL)),
  CHECK ((state IN ('queued', 'running')) = (finished_at IS NULL)),
  CHECK (state != 'running' OR started_at IS NOT NULL)
) STRICT;

CREATE TABLE block (
  id          INTEGER PRIMARY KEY AUTOINCREMENT,
  evaluation  INTEGER NOT NULL REFERENCES evaluation (id),
  first       INTEGER NOT NULL CHECK (first >= 0),
  last        INTEGER NOT NULL CHECK (last >= first),
  state       TEXT NOT NULL CHECK (state IN ('pending', 'running', 'done', 'failed', 'cancelled')),
  attempt     INTEGER NOT NULL DEFAULT 0 CHECK (attempt >= 0),            -- starts so far
  faults      INTEGER NOT NULL DEFAULT 0 CHECK (faults BETWEEN 0 AND attempt),  -- the grader's
  detail      TEXT NOT NULL DEFAULT '',  -- what went wrong last
  slot        INTEGER,
  owner       TEXT,                      -- the daemon that runs it
  started_at  INTEGER,
  deadline_at INTEGER,
  finished_at INTEGER,
  output_json TEXT,                      -- how the last attempt that reached its end went
  UNIQUE (evaluation, first),
  CHECK ((state = 'running') = (slot IS NOT NULL AND owner IS NOT NULL AND
                                started_at IS NOT NULL AND deadline_at IS NOT NULL)),
  CHECK (state = 'running' OR (slot IS NULL AND owner IS NULL AND deadline_at IS NULL)),
  CHECK ((state IN ('pending', 'running')) = (finished_at IS NULL))
) STRICT;

CREATE TABLE episode (
  evaluation   INTEGER NOT NULL REFERENCES evaluation (id),
  idx          INTEGER NOT NULL CHECK (idx >= 0),
  block        INTEGER NOT NULL REFERENCES block (id),
  attempt      INTEGER NOT NULL CHECK (attempt > 0),
  seed         INTEGER NOT NULL CHECK (seed >= 0),
  outcome      TEXT NOT NULL CHECK (outcome IN
                 ('success', 'failure', 'unstable', 'init_timeout', 'step_timeout', 'wall_timeout',
                  'cpu_limit', 'memory_limit', 'process_limit', 'disk_limit', 'output_limit',
                  'protocol', 'crash')),
  reason       TEXT NOT NULL CHECK (length(reason) <= 40),
  facts_json   TEXT NOT NULL,            -- as the simulator measured them
  metrics_json TEXT NOT NULL,            -- as scoring judged them
  recorded_at  INTEGER NOT NULL,
  log          TEXT NOT NULL,            -- its log's hash, as the facts have it; '': it has none
  PRIMARY KEY (evaluation, idx),
  CHECK ((outcome = 'failure') = (reason != ''))
) STRICT, WITHOUT ROWID;

CREATE TABLE episode_details (
  id           INTEGER PRIMARY KEY,
  evaluation   INTEGER NOT NULL,
  idx          INTEGER NOT NULL,
  details_json TEXT NOT NULL,
  UNIQUE (evaluation, idx),
  FOREIGN KEY (evaluation, idx) REFERENCES episode (evaluation, idx)
) STRICT;

CREATE TABLE replay (
  id           INTEGER PRIMARY KEY,
  evaluation   INTEGER NOT NULL,
  idx          INTEGER NOT NULL,
  attempt      INTEGER NOT NULL,
  differs_json TEXT NOT NULL,            -- names of what differs
  facts_json   TEXT NOT NULL,            -- of the later playing; the row in episode counts
  recorded_at  INTEGER NOT NULL,
  UNIQUE (evaluation, idx, attempt),
  FOREIGN KEY (evaluation, idx) REFERENCES episode (evaluation, idx)
) STRICT;

CREATE TABLE transition (
  id         INTEGER PRIMARY KEY AUTOINCREMENT,
  at         INTEGER NOT NULL,
  entity     TEXT NOT NULL CHECK (entity IN ('submission', 'evaluation', 'block')),
  entity_id  INTEGER NOT NULL,
  from_state TEXT NOT NULL,              -- '' for what is new
  to_state   TEXT NOT NULL,
  who        TEXT NOT NULL CHECK (length(who) > 0),
  why        TEXT NOT NULL
) STRICT;

CREATE TABLE attempt (
  block     INTEGER NOT NULL REFERENCES block (id),
  attempt   INTEGER NOT NULL CHECK (attempt > 0),
  node      TEXT NOT NULL,
  job       TEXT NOT NULL,               -- the cluster's name for it, such as 1234_5
  began_at  INTEGER,                     -- NULL: it waited for a processor until it ended
  ended_at  INTEGER NOT NULL,
  cpu_ms    INTEGER NOT NULL CHECK (cpu_ms >= 0),     -- of all its processes
  energy_mj INTEGER CHECK (energy_mj >= 0),           -- NULL: it was not measured
  how       TEXT NOT NULL CHECK (how IN ('done', 'fault', 'returned', 'cancelled')),
  PRIMARY KEY (block, attempt)
) STRICT, WITHOUT ROWID;

CREATE TABLE node_event (
  id    INTEGER PRIMARY KEY AUTOINCREMENT,
  at    INTEGER NOT NULL,
  node  TEXT NOT NULL CHECK (length(node) > 0),
  event TEXT NOT NULL CHECK (event IN ('drained', 'admitted')),
  who   TEXT NOT NULL CHECK (length(who) > 0),
  why   TEXT NOT NULL
) STRICT;

CREATE INDEX submission_by_team ON submission (team_id, id);
CREATE INDEX submission_by_board ON submission (config, ranked, id);
CREATE INDEX submission_by_day ON submission (day);
CREATE UNIQUE INDEX evaluation_original ON evaluation (submission) WHERE kind = 'original';
CREATE UNIQUE INDEX evaluation_of_rejudge ON evaluation (rejudge, submission, repetition)
  WHERE rejudge IS NOT NULL;
CREATE INDEX evaluation_by_submission ON evaluation (submission, id);
CREATE INDEX evaluation_unfinished ON evaluation (id) WHERE finished_at IS NULL;
CREATE INDEX block_unfinished ON block (evaluation) WHERE finished_at IS NULL;
CREATE INDEX transition_by_entity ON transition (entity, entity_id, id);
CREATE INDEX submission_by_artefact ON submission (artefact);
CREATE INDEX submission_by_official ON submission (team_id, artefact, config);
CREATE INDEX episode_by_log ON episode (log);
CREATE INDEX submission_by_phase ON submission (phase, id) WHERE phase != '';
CREATE INDEX evaluation_by_state ON evaluation (kind, state);
CREATE INDEX node_event_by_node ON node_event (node, id);
CREATE TRIGGER transition_fixed BEFORE UPDATE ON transition
  BEGIN SELECT RAISE(ABORT, 'audit rows are never changed'); END;
CREATE TRIGGER transition_kept BEFORE DELETE ON transition
  BEGIN SELECT RAISE(ABORT, 'audit rows are never deleted'); END;
CREATE TRIGGER episode_fixed
  BEFORE UPDATE OF evaluation, idx, block, attempt, seed, facts_json, log ON episode
  BEGIN SELECT RAISE(ABORT, 'the facts of an episode are never changed'); END;
CREATE TRIGGER episode_kept BEFORE DELETE ON episode
  BEGIN SELECT RAISE(ABORT, 'episodes are never deleted'); END;
CREATE TRIGGER episode_in_block BEFORE INSERT ON episode
  WHEN NOT EXISTS (SELECT 1 FROM block WHERE id = NEW.block AND evaluation = NEW.evaluation
                     AND NEW.idx BETWEEN first AND last)
  BEGIN SELECT RAISE(ABORT, 'an episode belongs to a block of its evaluation that holds it'); END;
CREATE TRIGGER replay_fixed BEFORE UPDATE ON replay
  BEGIN SELECT RAISE(ABORT, 'replay rows are never changed'); END;
CREATE TRIGGER replay_kept BEFORE DELETE ON replay
  BEGIN SELECT RAISE(ABORT, 'replay rows are never deleted'); END;
CREATE TRIGGER block_final BEFORE UPDATE OF state ON block
  WHEN OLD.finished_at IS NOT NULL
  BEGIN SELECT RAISE(ABORT, 'a block that ended stays ended'); END;
CREATE TRIGGER evaluation_final BEFORE UPDATE OF state ON evaluation
  WHEN OLD.finished_at IS NOT NULL
  BEGIN SELECT RAISE(ABORT, 'an evaluation that ended stays ended'); END;
CREATE TRIGGER submission_fixed BEFORE UPDATE OF team_id, track, phase, day ON submission
  BEGIN SELECT RAISE(ABORT, 'what a submission is charged by is never changed'); END;
CREATE TRIGGER submission_kept BEFORE DELETE ON submission
  BEGIN SELECT RAISE(ABORT, 'submissions are never deleted'); END;
CREATE TRIGGER episode_details_fixed BEFORE UPDATE ON episode_details
  BEGIN SELECT RAISE(ABORT, 'the details of an episode are never changed'); END;
CREATE TRIGGER episode_details_kept BEFORE DELETE ON episode_details
  BEGIN SELECT RAISE(ABORT, 'the details of an episode are never deleted'); END;
CREATE TRIGGER attempt_fixed BEFORE UPDATE ON attempt
  BEGIN SELECT RAISE(ABORT, 'what an attempt used is never changed'); END;
CREATE TRIGGER attempt_kept BEFORE DELETE ON attempt
  BEGIN SELECT RAISE(ABORT, 'what an attempt used is never deleted'); END;
CREATE TRIGGER node_event_fixed BEFORE UPDATE ON node_event
  BEGIN SELECT RAISE(ABORT, 'what was done to a node is never changed'); END;
CREATE TRIGGER node_event_kept BEFORE DELETE ON node_event
  BEGIN SELECT RAISE(ABORT, 'what was done to a node is never deleted'); END;

-- Quotas and removals.

CREATE TABLE ledger (
  id         INTEGER PRIMARY KEY AUTOINCREMENT,
  at         INTEGER NOT NULL,
  day        INTEGER NOT NULL CHECK (day >= 0),   -- the day that it counts for
  team_id    INTEGER NOT NULL REFERENCES team (id),
  track      TEXT NOT NULL,
  budget     TEXT NOT NULL CHECK (budget IN ('official', 'practice', 'failed')),
  entry      TEXT NOT NULL CHECK (entry IN ('charge', 'refund', 'grant')),
  amount     INTEGER NOT NULL CHECK (amount > 0),
  submission INTEGER REFERENCES submission (id),  -- NULL: a grant, or an upload that was refused
  who        TEXT NOT NULL CHECK (length(who) > 0),
  why        TEXT NOT NULL CHECK (length(why) > 0),
  phase      TEXT NOT NULL DEFAULT '',
  CHECK (entry != 'refund' OR submission IS NOT NULL)
) STRICT;

CREATE TABLE removal (
  id    INTEGER PRIMARY KEY AUTOINCREMENT,
  at    INTEGER NOT NULL,
  kind  TEXT NOT NULL CHECK (kind IN ('artefact', 'log')),
  name  TEXT NOT NULL CHECK (length(name) > 0),   -- its hash
  bytes INTEGER NOT NULL CHECK (bytes >= 0),
  why   TEXT NOT NULL CHECK (length(why) > 0)
) STRICT;

CREATE UNIQUE INDEX ledger_once ON ledger (submission, budget, entry)
  WHERE submission IS NOT NULL;
CREATE INDEX ledger_by_team ON ledger (team_id, track, id);
CREATE INDEX ledger_by_day ON ledger (day);
CREATE TRIGGER ledger_fixed BEFORE UPDATE ON ledger
  BEGIN SELECT RAISE(ABORT, 'ledger rows are never changed'); END;
CREATE TRIGGER ledger_kept BEFORE DELETE ON ledger
  BEGIN SELECT RAISE(ABORT, 'ledger rows are never deleted'); END;
CREATE TRIGGER ledger_refund BEFORE INSERT ON ledger
  WHEN NEW.entry = 'refund' AND NOT EXISTS
    (SELECT 1 FROM ledger WHERE submission = NEW.submission AND budget = NEW.budget
       AND entry = 'charge' AND amount = NEW.amount AND day = NEW.day)
  BEGIN SELECT RAISE(ABORT, 'a refund gives back one charge, for its day'); END;
CREATE TRIGGER removal_fixed BEFORE UPDATE ON removal
  BEGIN SELECT RAISE(ABORT, 'removals are never changed'); END;
CREATE TRIGGER removal_kept BEFORE DELETE ON removal
  BEGIN SELECT RAISE(ABORT, 'removals are never deleted'); END;

-- Phases of challenges.

CREATE TABLE phase_secret (
  phase      TEXT PRIMARY KEY CHECK (length(phase) > 0),
  secret     BLOB NOT NULL CHECK (length(secret) = 32),
  created_at INTEGER NOT NULL,
  challenge  TEXT NOT NULL DEFAULT ''    -- whose phase it is; '': the first that loads the phase
) STRICT;

CREATE TRIGGER phase_secret_fixed BEFORE UPDATE ON phase_secret
  WHEN OLD.challenge != '' OR NEW.phase IS NOT OLD.phase OR NEW.secret IS NOT OLD.secret OR
       NEW.created_at IS NOT OLD.created_at
  BEGIN SELECT RAISE(ABORT, 'a phase''s secret is never changed'); END;

-- The journal, and what webhooks are told.

CREATE TABLE journal (
  id           INTEGER PRIMARY KEY AUTOINCREMENT,
  at           INTEGER NOT NULL,
  kind         TEXT NOT NULL CHECK (kind IN ('accepted', 'graded', 'marked', 'chosen', 'team',
                                             'commitment', 'phase', 'config', 'rejudge', 'key')),
  who          TEXT NOT NULL CHECK (length(who) > 0),
  evaluation   INTEGER REFERENCES evaluation (id),  -- that it is the end of; NULL: none
  private_json TEXT NOT NULL CHECK (json_valid(private_json)),
  entry        INTEGER UNIQUE CHECK (entry >= 0),   -- in the public record; NULL: it is not public
  entry_json   TEXT CHECK (entry_json IS NULL OR json_valid(entry_json)), -- canonical
  chain        TEXT CHECK (length(chain) = 64),
  CHECK ((entry IS NULL) = (entry_json IS NULL) AND (entry IS NULL) = (chain IS NULL)),
  CHECK ((kind = 'graded') = (evaluation IS NOT NULL))
) STRICT;

CREATE TABLE delivery (
  id         INTEGER PRIMARY KEY AUTOINCREMENT,
  at         INTEGER NOT NULL,
  webhook    TEXT NOT NULL CHECK (length(webhook) > 0),   -- its name in server.json
  event      TEXT NOT NULL CHECK (length(event) > 0),
  body_json  TEXT NOT NULL,
  state      TEXT NOT NULL CHECK (state IN ('waiting', 'delivered', 'given_up')),
  attempts   INTEGER NOT NULL DEFAULT 0 CHECK (attempts >= 0),
  due_at     INTEGER NOT NULL,           -- of the next attempt
  detail     TEXT NOT NULL DEFAULT ''    -- what went wrong last
) STRICT;

CREATE INDEX delivery_waiting ON delivery (webhook, id) WHERE state = 'waiting';
CREATE UNIQUE INDEX journal_by_evaluation ON journal (evaluation) WHERE evaluation IS NOT NULL;
CREATE TRIGGER journal_in_order BEFORE INSERT ON journal
  WHEN NEW.entry !=
    (SELECT ifnull(max(entry) + 1, 0) FROM journal WHERE entry BETWEEN 0 AND 1 << 40)
  BEGIN SELECT RAISE(ABORT, 'the entries of the record are numbered 0, 1, 2 and so on'); END;
CREATE TRIGGER journal_fixed BEFORE UPDATE ON journal
  BEGIN SELECT RAISE(ABORT, 'the journal is never changed'); END;
CREATE TRIGGER journal_kept BEFORE DELETE ON journal
  BEGIN SELECT RAISE(ABORT, 'the journal is never deleted'); END;

-- Boards. The table can be dropped and made again.

CREATE TABLE standing (
  evaluation     INTEGER PRIMARY KEY REFERENCES evaluation (id),
  aggregate_json TEXT NOT NULL
) STRICT;
