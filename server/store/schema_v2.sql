-- Version 2 of the store: quotas with a ledger, marks on submissions, boards as a view.
--
--   admission    what an accepted submission will be charged to, and for which day
--   ledger       every charge, refund and grant of a team's quota
--   mark         every time a submission was hidden, disqualified or marked as baseline, or brought
--                back; the newest row of a submission and mark is in force
--   removal      files that were removed from the data folder, by the organiser's policy
--   standing     what a finished evaluation is ranked by: a view of its episode rows, which can be
--                dropped and made again at any time
--   board_state  counts the changes that can touch a board, so that a kept board is never stale
--
-- Invariants:
--   7. A submission is charged once in each budget, and each charge is refunded at most once.
--   8. Ledger, marks and admissions are never changed or deleted.
--   9. A day is the number of whole days since 1970-01-01 UTC: the clock's, or the day after if the
--      admissions or the ledger have rows of that already.

CREATE TABLE admission (
  submission INTEGER PRIMARY KEY REFERENCES submission (id),
  team_id    INTEGER NOT NULL REFERENCES team (id),
  track      TEXT NOT NULL,
  budget     TEXT NOT NULL CHECK (budget IN ('official', 'practice')),
  day        INTEGER NOT NULL CHECK (day >= 0)
) STRICT;
CREATE INDEX admission_by_team ON admission (team_id, track, budget, day);
CREATE INDEX admission_by_day ON admission (day);

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
  CHECK (entry != 'refund' OR submission IS NOT NULL)
) STRICT;
CREATE UNIQUE INDEX ledger_once ON ledger (submission, budget, entry)
  WHERE submission IS NOT NULL;
CREATE INDEX ledger_by_team ON ledger (team_id, track, id);
CREATE INDEX ledger_by_day ON ledger (day);

CREATE TABLE mark (
  id         INTEGER PRIMARY KEY AUTOINCREMENT,
  at         INTEGER NOT NULL,
  submission INTEGER NOT NULL REFERENCES submission (id),
  mark       TEXT NOT NULL CHECK (mark IN ('hidden', 'disqualified', 'baseline')),
  set_to     INTEGER NOT NULL CHECK (set_to IN (0, 1)),
  who        TEXT NOT NULL CHECK (length(who) > 0),
  why        TEXT NOT NULL
) STRICT;
CREATE INDEX mark_by_submission ON mark (submission, mark, id);

CREATE TABLE removal (
  id    INTEGER PRIMARY KEY AUTOINCREMENT,
  at    INTEGER NOT NULL,
  kind  TEXT NOT NULL CHECK (kind IN ('artefact', 'log')),
  name  TEXT NOT NULL CHECK (length(name) > 0),   -- its hash
  bytes INTEGER NOT NULL CHECK (bytes >= 0),
  why   TEXT NOT NULL CHECK (length(why) > 0)
) STRICT;

CREATE TABLE standing (
  evaluation     INTEGER PRIMARY KEY REFERENCES evaluation (id),
  aggregate_json TEXT NOT NULL
) STRICT;

CREATE TABLE board_state (
  id      INTEGER PRIMARY KEY CHECK (id = 1),
  changes INTEGER NOT NULL
) STRICT;
INSERT INTO board_state VALUES (1, 0);

CREATE INDEX submission_by_artefact ON submission (artefact);
CREATE INDEX submission_by_official ON submission (team_id, artefact, config);

CREATE TRIGGER board_by_evaluation AFTER UPDATE OF state ON evaluation WHEN NEW.state = 'done'
  BEGIN UPDATE board_state SET changes = changes + 1; END;
CREATE TRIGGER board_by_new_evaluation AFTER INSERT ON evaluation WHEN NEW.state = 'done'
  BEGIN UPDATE board_state SET changes = changes + 1; END;
CREATE TRIGGER board_by_mark AFTER INSERT ON mark
  BEGIN UPDATE board_state SET changes = changes + 1; END;
CREATE TRIGGER board_by_standing AFTER INSERT ON standing
  BEGIN UPDATE board_state SET changes = changes + 1; END;
CREATE TRIGGER board_by_dropping AFTER DELETE ON standing
  BEGIN UPDATE board_state SET changes = changes + 1; END;

CREATE TRIGGER admission_fixed BEFORE UPDATE ON admission
  BEGIN SELECT RAISE(ABORT, 'an admission is never changed'); END;
CREATE TRIGGER admission_kept BEFORE DELETE ON admission
  BEGIN SELECT RAISE(ABORT, 'an admission is never deleted'); END;
CREATE TRIGGER ledger_fixed BEFORE UPDATE ON ledger
  BEGIN SELECT RAISE(ABORT, 'ledger rows are never changed'); END;
CREATE TRIGGER ledger_kept BEFORE DELETE ON ledger
  BEGIN SELECT RAISE(ABORT, 'ledger rows are never deleted'); END;
CREATE TRIGGER ledger_refund BEFORE INSERT ON ledger
  WHEN NEW.entry = 'refund' AND NOT EXISTS
    (SELECT 1 FROM ledger WHERE submission = NEW.submission AND budget = NEW.budget
       AND entry = 'charge' AND amount = NEW.amount AND day = NEW.day)
  BEGIN SELECT RAISE(ABORT, 'a refund gives back one charge, for its day'); END;
CREATE TRIGGER mark_fixed BEFORE UPDATE ON mark
  BEGIN SELECT RAISE(ABORT, 'marks are never changed; a further row takes one back'); END;
CREATE TRIGGER mark_kept BEFORE DELETE ON mark
  BEGIN SELECT RAISE(ABORT, 'marks are never deleted; a further row takes one back'); END;
CREATE TRIGGER removal_fixed BEFORE UPDATE ON removal
  BEGIN SELECT RAISE(ABORT, 'removals are never changed'); END;
CREATE TRIGGER removal_kept BEFORE DELETE ON removal
  BEGIN SELECT RAISE(ABORT, 'removals are never deleted'); END;
CREATE TRIGGER submission_kept BEFORE DELETE ON submission
  BEGIN SELECT RAISE(ABORT, 'submissions are never deleted'); END;
