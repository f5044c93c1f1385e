-- Version 9 of the store: what pages and reports show of an episode besides its facts.
--
--   episode      `details_json` has the details that the simulator measured; NULL for those of earlier
--                versions and for episodes without a step. No result follows from it.

ALTER TABLE episode ADD COLUMN details_json TEXT;

DROP TRIGGER episode_fixed;
CREATE TRIGGER episode_fixed
  BEFORE UPDATE OF evaluation, idx, lease, attempt, seed, facts_json, details_json ON episode
  BEGIN SELECT RAISE(ABORT, 'the facts of an episode are never changed'); END;
