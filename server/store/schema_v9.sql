-- Version 9 of the store: what pages and reports show of an episode besides its facts.
--
--   episode_details   the details that the simulator measured (protocol/README.md). No result follows
--                     from them; episodes of earlier versions and those without a step have none. A
--                     table of their own, as a row of `episode` with them would not fit into a page.

CREATE TABLE episode_details (
  id           INTEGER PRIMARY KEY,
  evaluation   INTEGER NOT NULL,
  idx          INTEGER NOT NULL,
  details_json TEXT NOT NULL,
  UNIQUE (evaluation, idx),
  FOREIGN KEY (evaluation, idx) REFERENCES episode (evaluation, idx)
) STRICT;

CREATE TRIGGER episode_details_fixed BEFORE UPDATE ON episode_details
  BEGIN SELECT RAISE(ABORT, 'the details of an episode are never changed'); END;
CREATE TRIGGER episode_details_kept BEFORE DELETE ON episode_details
  BEGIN SELECT RAISE(ABORT, 'the details of an episode are never deleted'); END;
