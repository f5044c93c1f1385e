-- Version 7 of the store: results by changed rules, and a public record.
--
--   evaluation     may be a 'rejudge': a submission's result under another config than its own, whose
--                  seeds may differ too. `config` and `seeds` are NULL for those of the submission
--   rejudge        a board's submissions, all judged again. For purpose 'rules' the results of
--                  to_config take the place of those of from_config; for 'seeds' they are further
--                  episodes, which statistics use and no rank
--   rejudge_item   which evaluation it has of a submission, of which evaluation that is the new
--                  result, and whether it was computed from that one's facts or played. Of several
--                  repetitions the first one counts
--   rejudge_event  what became of it; the newest row is in force. The document says what was done,
--                  and is signed with the key of receipts
--   board_config   the config that the board of a phase, or of a track's profile where no phase is
--                  named, had from then on
--   record         what anybody may check afterwards: entries that are only ever added. `chain` is
--                  the SHA-256 over the digits of the entry before ('' for the first), a line feed
--                  and the entry
--   delivery       what webhooks are told, until they have taken it
--
-- Invariants:
--   12. Rejudges, their items and events, board configs and the record are never changed or deleted.
--   13. The ids of the record are 0, 1, 2 and so on.
--   14. An evaluation of the kind 'rejudge' has one item.

PRAGMA writable_schema = ON;
UPDATE sqlite_schema SET sql = replace(sql, '(''original'', ''rerun'')',
                                       '(''original'', ''rerun'', ''rejudge'')')
  WHERE type = 'table' AND name = 'evaluation';
PRAGMA writable_schema = RESET;
ALTER TABLE evaluation ADD COLUMN config TEXT REFERENCES config (hash);
ALTER TABLE evaluation ADD COLUMN seeds TEXT REFERENCES seed_list (hash);

CREATE TABLE rejudge (
  id          INTEGER PRIMARY KEY AUTOINCREMENT,
  at          INTEGER NOT NULL,
  purpose     TEXT NOT NULL CHECK (purpose IN ('rules', 'seeds')),
  phase       TEXT NOT NULL,             -- '': the track's own board
  track       TEXT NOT NULL,
  profile     TEXT NOT NULL,
  from_config TEXT NOT NULL REFERENCES config (hash),
  to_config   TEXT NOT NULL REFERENCES config (hash),
  seeds       TEXT NOT NULL REFERENCES seed_list (hash),
  method      TEXT NOT NULL CHECK (method IN ('auto', 'facts', 'play')),
  repeats     INTEGER NOT NULL CHECK (repeats BETWEEN 1 AND 20),
  who         TEXT NOT NULL CHECK (length(who) > 0),
  why         TEXT NOT NULL CHECK (length(why) > 0)
) STRICT;

CREATE TABLE rejudge_item (
  rejudge    INTEGER NOT NULL REFERENCES rejudge (id),
  submission INTEGER NOT NULL REFERENCES submission (id),
  repetition INTEGER NOT NULL CHECK (repetition >= 1),
  source     INTEGER NOT NULL REFERENCES evaluation (id),
  method     TEXT NOT NULL CHECK (method IN ('facts', 'play')),
  evaluation INTEGER NOT NULL UNIQUE REFERENCES evaluation (id),
  PRIMARY KEY (rejudge, submission, repetition)
) STRICT, WITHOUT ROWID;
CREATE INDEX rejudge_item_by_submission ON rejudge_item (submission, rejudge);

CREATE TABLE rejudge_event (
  id            INTEGER PRIMARY KEY AUTOINCREMENT,
  at            INTEGER NOT NULL,
  rejudge       INTEGER NOT NULL REFERENCES rejudge (id),
  event         TEXT NOT NULL CHECK (event IN ('created', 'applied', 'dropped')),
  who           TEXT NOT NULL CHECK (length(who) > 0),
  why           TEXT NOT NULL CHECK (length(why) > 0),
  document_json TEXT NOT NULL,           -- canonical
  signature     TEXT NOT NULL CHECK (length(signature) = 128)
) STRICT;
CREATE INDEX rejudge_event_by_rejudge ON rejudge_event (rejudge, id);

CREATE TABLE board_config (
  id      INTEGER PRIMARY KEY AUTOINCREMENT,
  at      INTEGER NOT NULL,
  phase   TEXT NOT NULL,
  track   TEXT NOT NULL,
  profile TEXT NOT NULL,
  config  TEXT NOT NULL REFERENCES config (hash),
  rejudge INTEGER REFERENCES rejudge (id),   -- whose act it was; NULL: the config files changed
  who     TEXT NOT NULL CHECK (length(who) > 0)
) STRICT;
CREATE INDEX board_config_by_board ON board_config (phase, track, profile, id);

CREATE TABLE record (
  id         INTEGER PRIMARY KEY CHECK (id >= 0),
  at         INTEGER NOT NULL,
  kind       TEXT NOT NULL CHECK (length(kind) > 0),
  evaluation INTEGER,                    -- that the entry is about; NULL: none
  entry_json TEXT NOT NULL,              -- canonical
  chain      TEXT NOT NULL CHECK (length(chain) = 64)
) STRICT;
CREATE INDEX record_by_evaluation ON record (evaluation, id) WHERE evaluation IS NOT NULL;

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
CREATE INDEX evaluation_by_state ON evaluation (kind, state);  -- to count them

DROP TRIGGER board_by_standing;
CREATE TRIGGER board_by_standing AFTER INSERT ON standing
  WHEN EXISTS (SELECT 1 FROM evaluation AS e JOIN submission AS s ON s.id = e.submission
                 WHERE e.id = NEW.evaluation AND e.kind IN ('original', 'rejudge') AND s.ranked = 1)
  BEGIN UPDATE board_state SET changes = changes + 1; END;
-- Further episodes that all failed have no standing, and count in the board's statistics.
CREATE TRIGGER board_by_failed_rejudge AFTER UPDATE OF state ON evaluation
  WHEN NEW.kind = 'rejudge' AND NEW.state = 'failed'
  BEGIN UPDATE board_state SET changes = changes + 1; END;
CREATE TRIGGER board_by_rejudge AFTER INSERT ON rejudge_event
  BEGIN UPDATE board_state SET changes = changes + 1; END;
CREATE TRIGGER board_by_config AFTER INSERT ON board_config
  BEGIN UPDATE board_state SET changes = changes + 1; END;

CREATE TRIGGER rejudge_fixed BEFORE UPDATE ON rejudge
  BEGIN SELECT RAISE(ABORT, 'a rejudge is never changed'); END;
CREATE TRIGGER rejudge_kept BEFORE DELETE ON rejudge
  BEGIN SELECT RAISE(ABORT, 'a rejudge is never deleted'); END;
CREATE TRIGGER rejudge_item_fixed BEFORE UPDATE ON rejudge_item
  BEGIN SELECT RAISE(ABORT, 'what a rejudge holds is never changed'); END;
CREATE TRIGGER rejudge_item_kept BEFORE DELETE ON rejudge_item
  BEGIN SELECT RAISE(ABORT, 'what a rejudge holds is never deleted'); END;
CREATE TRIGGER rejudge_event_fixed BEFORE UPDATE ON rejudge_event
  BEGIN SELECT RAISE(ABORT, 'what became of a rejudge is never changed'); END;
CREATE TRIGGER rejudge_event_kept BEFORE DELETE ON rejudge_event
  BEGIN SELECT RAISE(ABORT, 'what became of a rejudge is never deleted'); END;
CREATE TRIGGER board_config_fixed BEFORE UPDATE ON board_config
  BEGIN SELECT RAISE(ABORT, 'the configs that boards had are never changed'); END;
CREATE TRIGGER board_config_kept BEFORE DELETE ON board_config
  BEGIN SELECT RAISE(ABORT, 'the configs that boards had are never deleted'); END;
CREATE TRIGGER record_in_order BEFORE INSERT ON record
  WHEN NEW.id != (SELECT ifnull(max(id) + 1, 0) FROM record)
  BEGIN SELECT RAISE(ABORT, 'the record''s ids are 0, 1, 2 and so on'); END;
CREATE TRIGGER record_fixed BEFORE UPDATE ON record
  BEGIN SELECT RAISE(ABORT, 'the record is never changed'); END;
CREATE TRIGGER record_kept BEFORE DELETE ON record
  BEGIN SELECT RAISE(ABORT, 'the record is never deleted'); END;
