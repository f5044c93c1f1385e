-- The store of a MyoGrade daemon, version 1 (PRAGMA user_version). Later versions are further files
-- beside this one, applied in order, each in one transaction; this file never changes.
--
-- Content never changes and is found by its hash:
--   artefact     what was submitted (its files lie in DATA/artefacts/HASH)
--   config       the effective track config of one profile
--   seed_list    the seeds of an evaluation, in the order of play
-- What happens:
--   submission   a team asks for an artefact to be graded; its id is the acceptance number
--   evaluation   one playing of it: the original, or a re-run of some of its leases
--   lease        a block of consecutive episodes of an evaluation, played by one policy process
--   episode      one row for each episode played: the facts, and what scoring made of them
--   replay       an episode of a repeated lease that came out otherwise than its row
--   transition   every change of state: when, from, to, who, why
--
-- States, and the function of Store that makes each step (anything else is refused by CHECK, by
-- trigger, or by the store's own comparison with the state before):
--
--   lease        pending --StartLease--> running --FinishLease--> done
--                   ^                      |  |
--                   +-----ReturnLease------+  +--------EndLease----> failed | cancelled
--                   +--------------------EndLease------------------> cancelled
--
--   evaluation   queued --StartLease (first)--> running --EndEvaluation--> done | failed |
--                   |                                                    cancelled | grader_error
--                   +---------EndEvaluation---> cancelled | grader_error
--
-- Invariants:
--   1. (evaluation, idx) is the key of an episode: it counts once, however often played.
--   2. An episode's identity and facts, audit rows and content rows are never changed or deleted.
--   3. A running lease has a slot, an owner, a start and a deadline; a lease that does not run has
--      no slot and no deadline.
--   4. A submission has exactly one original evaluation (inserted in the same transaction).
--   5. The leases of an evaluation do not overlap and cover [first, last].
--   6. Every change of a state inserts its transition in the same transaction.
--
-- Times are milliseconds since 1970-01-01 UTC: for people, and never for an order or a decision.
-- Booleans are 0 and 1. Text columns named *_json hold canonical JSON.

CREATE TABLE meta (
  key   TEXT PRIMARY KEY,
  value BLOB NOT NULL            -- 'policy_secret': 32 random bytes, made with the store
) STRICT;

CREATE TABLE team (
  id         INTEGER PRIMARY KEY,
  name       TEXT NOT NULL UNIQUE CHECK (length(name) > 0),
  created_at INTEGER NOT NULL
) STRICT;

CREATE TABLE artefact (
  hash          TEXT PRIMARY KEY CHECK (length(hash) = 64),
  name          TEXT NOT NULL,   -- as its policy.json says
  command_json  TEXT NOT NULL,   -- array of strings
  runtimes_json TEXT NOT NULL,   -- array of names of configured runtimes
  bytes         INTEGER NOT NULL CHECK (bytes >= 0),
  files         INTEGER NOT NULL CHECK (files >= 0),
  created_at    INTEGER NOT NULL
) STRICT;

CREATE TABLE config (
  hash           TEXT PRIMARY KEY CHECK (length(hash) = 64),
  track          TEXT NOT NULL,
  profile        TEXT NOT NULL,
  effective_json TEXT NOT NULL,
  created_at     INTEGER NOT NULL
) STRICT;

CREATE TABLE seed_list (
  hash       TEXT PRIMARY KEY CHECK (length(hash) = 64),
  count      INTEGER NOT NULL CHECK (count > 0),
  seeds_json TEXT NOT NULL
) STRICT;

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
  accepted_at INTEGER NOT NULL
) STRICT;
CREATE INDEX submission_by_team ON submission (team_id, id);
CREATE INDEX submission_by_board ON submission (config, ranked, id);

CREATE TABLE evaluation (
  id           INTEGER PRIMARY KEY AUTOINCREMENT,
  submission   INTEGER NOT NULL REFERENCES submission (id),
  kind         TEXT NOT NULL CHECK (kind IN ('original', 'rerun')),
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
  CHECK ((state IN ('queued', 'running')) = (finished_at IS NULL)),
  CHECK (state != 'running' OR started_at IS NOT NULL)
) STRICT;
CREATE UNIQUE INDEX evaluation_original ON evaluation (submission) WHERE kind = 'original';
CREATE INDEX evaluation_by_submission ON evaluation (submission, id);
CREATE INDEX evaluation_unfinished ON evaluation (id) WHERE finished_at IS NULL;

CREATE TABLE lease (
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
CREATE INDEX lease_unfinished ON lease (evaluation) WHERE finished_at IS NULL;

CREATE TABLE episode (
  evaluation   INTEGER NOT NULL REFERENCES evaluation (id),
  idx          INTEGER NOT NULL CHECK (idx >= 0),
  lease        INTEGER NOT NULL REFERENCES lease (id),
  attempt      INTEGER NOT NULL CHECK (attempt > 0),
  seed         INTEGER NOT NULL CHECK (seed >= 0),
  outcome      TEXT NOT NULL CHECK (outcome IN
                 ('success', 'failure', 'unstable', 'init_timeout', 'step_timeout', 'wall_timeout',
                  'cpu_limit', 'memory_limit', 'process_limit', 'disk_limit', 'output_limit',
                  'protocol', 'crash')),
  reason       TEXT NOT NULL CHECK (reason IN
                 ('', 'dropped', 'time', 'force', 'handover', 'contact', 'fell', 'off-track')),
  facts_json   TEXT NOT NULL,            -- as the simulator measured them
  metrics_json TEXT NOT NULL,            -- as scoring judged them
  recorded_at  INTEGER NOT NULL,
  PRIMARY KEY (evaluation, idx),
  CHECK ((outcome = 'failure') = (reason != ''))
) STRICT, WITHOUT ROWID;

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
  entity     TEXT NOT NULL CHECK (entity IN ('submission', 'evaluation', 'lease')),
  entity_id  INTEGER NOT NULL,
  from_state TEXT NOT NULL,              -- '' for what is new
  to_state   TEXT NOT NULL,
  who        TEXT NOT NULL CHECK (length(who) > 0),
  why        TEXT NOT NULL
) STRICT;
CREATE INDEX transition_by_entity ON transition (entity, entity_id, id);

CREATE TRIGGER transition_fixed BEFORE UPDATE ON transition
  BEGIN SELECT RAISE(ABORT, 'audit rows are never changed'); END;
CREATE TRIGGER transition_kept BEFORE DELETE ON transition
  BEGIN SELECT RAISE(ABORT, 'audit rows are never deleted'); END;
CREATE TRIGGER episode_fixed
  BEFORE UPDATE OF evaluation, idx, lease, attempt, seed, facts_json ON episode
  BEGIN SELECT RAISE(ABORT, 'the facts of an episode are never changed'); END;
CREATE TRIGGER episode_kept BEFORE DELETE ON episode
  BEGIN SELECT RAISE(ABORT, 'episodes are never deleted'); END;
CREATE TRIGGER episode_in_lease BEFORE INSERT ON episode
  WHEN NOT EXISTS (SELECT 1 FROM lease WHERE id = NEW.lease AND evaluation = NEW.evaluation
                     AND NEW.idx BETWEEN first AND last)
  BEGIN SELECT RAISE(ABORT, 'an episode belongs to a lease of its evaluation that holds it'); END;
CREATE TRIGGER replay_fixed BEFORE UPDATE ON replay
  BEGIN SELECT RAISE(ABORT, 'replay rows are never changed'); END;
CREATE TRIGGER replay_kept BEFORE DELETE ON replay
  BEGIN SELECT RAISE(ABORT, 'replay rows are never deleted'); END;
CREATE TRIGGER artefact_fixed BEFORE UPDATE ON artefact
  BEGIN SELECT RAISE(ABORT, 'an artefact is never changed'); END;
CREATE TRIGGER config_fixed BEFORE UPDATE ON config
  BEGIN SELECT RAISE(ABORT, 'a config is never changed'); END;
CREATE TRIGGER seed_list_fixed BEFORE UPDATE ON seed_list
  BEGIN SELECT RAISE(ABORT, 'a seed list is never changed'); END;
CREATE TRIGGER lease_final BEFORE UPDATE OF state ON lease
  WHEN OLD.finished_at IS NOT NULL
  BEGIN SELECT RAISE(ABORT, 'a lease that ended stays ended'); END;
CREATE TRIGGER evaluation_final BEFORE UPDATE OF state ON evaluation
  WHEN OLD.finished_at IS NOT NULL
  BEGIN SELECT RAISE(ABORT, 'an evaluation that ended stays ended'); END;
