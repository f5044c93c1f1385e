-- Version 5 of the store.
--
--   standing   the ranked numbers of any track: their names, and the numbers as they are in memory.
--              The view is made again of the episode rows at the daemon's next start.
--   episode    the reasons of a failure are the track's own words, so the CHECK names none of them.
--              Only its text changes, and no row: what is in the table stays as it is, to the byte.

PRAGMA writable_schema = ON;
UPDATE sqlite_schema SET sql = substr(sql, 1, instr(sql, '(reason IN') - 1) ||
                               '(length(reason) <= 40' ||
                               substr(sql, instr(sql, '''given-up'', ''phantom'')') +
                                           length('''given-up'', ''phantom'')'))
  WHERE type = 'table' AND name = 'episode';
PRAGMA writable_schema = RESET;

DROP TABLE standing;
CREATE TABLE standing (
  evaluation     INTEGER PRIMARY KEY REFERENCES evaluation (id),
  successes      INTEGER NOT NULL,
  episodes       INTEGER NOT NULL,
  names          TEXT NOT NULL,  -- of the numbers that boards rank by, joined with commas
  numbers        BLOB NOT NULL,  -- a double each, least significant byte first; NaN is none
  aggregate_json TEXT NOT NULL   -- holds the numbers above too
) STRICT;
CREATE TRIGGER board_by_standing AFTER INSERT ON standing
  WHEN EXISTS (SELECT 1 FROM evaluation AS e JOIN submission AS s ON s.id = e.submission
                 WHERE e.id = NEW.evaluation AND e.kind = 'original' AND s.ranked = 1)
  BEGIN UPDATE board_state SET changes = changes + 1; END;
CREATE TRIGGER board_by_dropping AFTER DELETE ON standing
  BEGIN UPDATE board_state SET changes = changes + 1; END;
