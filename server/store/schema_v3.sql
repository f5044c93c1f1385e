-- Version 3 of the store: boards that cost what their rows cost.
--
--   standing     as in version 2, with the ranked numbers beside the text, so that a board is made
--                without reading the texts of the submissions that it does not show. The view is
--                made again of the episode rows at the daemon's next start.
--   board_state  is counted up by evaluations that may rank, and no longer by practice and re-runs.

DROP TABLE standing;
CREATE TABLE standing (
  evaluation     INTEGER PRIMARY KEY REFERENCES evaluation (id),
  successes      INTEGER NOT NULL,
  episodes       INTEGER NOT NULL,
  time_s         REAL NOT NULL,
  effort         REAL,                    -- NULL: there is none
  pain           REAL,
  distance_m     REAL,
  aggregate_json TEXT NOT NULL            -- holds the numbers above too
) STRICT;

DROP TRIGGER board_by_evaluation;
CREATE TRIGGER board_by_evaluation AFTER UPDATE OF state ON evaluation
  WHEN NEW.state = 'done' AND NEW.kind = 'original' AND
       EXISTS (SELECT 1 FROM submission WHERE id = NEW.submission AND ranked = 1)
  BEGIN UPDATE board_state SET changes = changes + 1; END;
CREATE TRIGGER board_by_standing AFTER INSERT ON standing
  WHEN EXISTS (SELECT 1 FROM evaluation AS e JOIN submission AS s ON s.id = e.submission
                 WHERE e.id = NEW.evaluation AND e.kind = 'original' AND s.ranked = 1)
  BEGIN UPDATE board_state SET changes = changes + 1; END;
CREATE TRIGGER board_by_dropping AFTER DELETE ON standing
  BEGIN UPDATE board_state SET changes = changes + 1; END;
