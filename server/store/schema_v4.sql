-- Version 4 of the store.
--
--   episode      a failure may also be 'given-up' (the policy asked for the next episode) or 'phantom'
--                (ended by what the episode before it left behind). A CHECK can't be changed in place,
--                so the table is made again: same columns, same rows, same triggers.
--   team_look    what a team's name looks like (server/names.h): names that share a look can be taken
--                for one another. A view of the table team, made again when the rule for it changes.
--   standing     has effort and pain over all steps of an evaluation, too. The view is made again of
--                the episode rows at the daemon's next start.

CREATE TABLE episode_v4 (
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
                 ('', 'dropped', 'time', 'force', 'handover', 'contact', 'fell', 'off-track',
                  'given-up', 'phantom')),
  facts_json   TEXT NOT NULL,            -- as the simulator measured them
  metrics_json TEXT NOT NULL,            -- as scoring judged them
  recorded_at  INTEGER NOT NULL,
  PRIMARY KEY (evaluation, idx),
  CHECK ((outcome = 'failure') = (reason != ''))
) STRICT, WITHOUT ROWID;
INSERT INTO episode_v4 SELECT evaluation, idx, lease, attempt, seed, outcome, reason, facts_json,
                              metrics_json, recorded_at FROM episode;
DROP TABLE episode;
ALTER TABLE episode_v4 RENAME TO episode;

CREATE TRIGGER episode_fixed
  BEFORE UPDATE OF evaluation, idx, lease, attempt, seed, facts_json ON episode
  BEGIN SELECT RAISE(ABORT, 'the facts of an episode are never changed'); END;
CREATE TRIGGER episode_kept BEFORE DELETE ON episode
  BEGIN SELECT RAISE(ABORT, 'episodes are never deleted'); END;
CREATE TRIGGER episode_in_lease BEFORE INSERT ON episode
  WHEN NOT EXISTS (SELECT 1 FROM lease WHERE id = NEW.lease AND evaluation = NEW.evaluation
                     AND NEW.idx BETWEEN first AND last)
  BEGIN SELECT RAISE(ABORT, 'an episode belongs to a lease of its evaluation that holds it'); END;

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
