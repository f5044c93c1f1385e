-- Version 8 of the store: what policy.json may ask for besides a program and runtimes.
--
--   artefact     `options_json` is an object with a key for each of its further wishes
--                (artefact_options.h); those of earlier versions have none
--   submission   whether its policy is shown the extra observations of its track: it asked for them,
--                and its profile allowed it when it was accepted

ALTER TABLE artefact ADD COLUMN options_json TEXT NOT NULL DEFAULT '{}';
ALTER TABLE submission ADD COLUMN extra_observations INTEGER NOT NULL DEFAULT 0
  CHECK (extra_observations IN (0, 1));
