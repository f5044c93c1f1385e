-- Version 4 of the store.
--
--   episode          a failure may also be 'given-up' (the policy asked for the next episode) or
--                    'phantom' (ended by what the episode before it left behind). Only the text of a
--                    CHECK changes, and no row: what is in the table stays as it is, to the byte.
--   episode_by_log   finds the episodes of a log by its hash: '' for those without one, NULL for
--                    those whose facts can't be read. What asks for it uses the same words
--                    (store_files.cc).
--   team_look        what a team's name looks like (server/names.h): names that share a look can be
--                    taken for one another. A view of the table team, made again when the rule for it
--                    changes.
--   standing         has effort and pain over all steps of an evaluation, too. The view is made again
--                    of the episode rows at the daemon's next start.
--   artefact         has the variables that its policy.json sets for its policy.
--   upload           artefacts whose files lie here and that no submission has asked for: whose they
--                    are, and since when. A submission takes its artefact's row away, and so does the
--                    removal of the files. Those of earlier versions count from now on, for nobody.

ALTER TABLE artefact ADD COLUMN environment_json TEXT NOT NULL DEFAULT '{}';  -- texts by name

PRAGMA writable_schema = ON;
UPDATE sqlite_schema SET sql = replace(sql, '''fell'', ''off-track'')',
                                       '''fell'', ''off-track'', ''given-up'', ''phantom'')')
  WHERE type = 'table' AND name = 'episode';
PRAGMA writable_schema = RESET;

CREATE INDEX episode_by_log ON episode (
  CASE WHEN typeof(facts_json) = 'text' AND json_valid(facts_json)
  THEN ifnull(json_extract(facts_json, '$.log.sha256'), '') END);

CREATE TABLE team_look (
  look TEXT NOT NULL,
  team INTEGER NOT NULL REFERENCES team (id),
  PRIMARY KEY (look, team)
) STRICT, WITHOUT ROWID;
CREATE INDEX team_look_by_team ON team_look (team);

DROP TABLE standing;
CREATE TABLE standing (
  evaluation        INTEGER PRIMARY KEY REFERENCES evaluation (id),
  successes         INTEGER NOT NULL,
  episodes          INTEGER NOT NULL,
  time_s            REAL NOT NULL,
  effort            REAL,                 -- NULL: there is none
  pain              REAL,
  distance_m        REAL,
  effort_over_steps REAL,
  pain_over_steps   REAL,
  aggregate_json    TEXT NOT NULL         -- holds the numbers above too
) STRICT;
CREATE TRIGGER board_by_standing AFTER INSERT ON standing
  WHEN EXISTS (SELECT 1 FROM evaluation AS e JOIN submission AS s ON s.id = e.submission
                 WHERE e.id = NEW.evaluation AND e.kind = 'original' AND s.ranked = 1)
  BEGIN UPDATE board_state SET changes = changes + 1; END;
CREATE TRIGGER board_by_dropping AFTER DELETE ON standing
  BEGIN UPDATE board_state SET changes = changes + 1; END;

CREATE TABLE upload (
  artefact TEXT PRIMARY KEY REFERENCES artefact (hash),
  uploader TEXT NOT NULL,                -- as 'uid 1000'; '' is not known
  team     TEXT NOT NULL,                -- '' is not known
  at       INTEGER NOT NULL
) STRICT;
CREATE INDEX upload_by_uploader ON upload (uploader);
CREATE INDEX upload_by_team ON upload (team);
INSERT INTO upload SELECT hash, '', '', unixepoch() * 1000 FROM artefact
  WHERE hash NOT IN (SELECT artefact FROM submission)
    AND hash NOT IN (SELECT name FROM removal WHERE kind = 'artefact');
