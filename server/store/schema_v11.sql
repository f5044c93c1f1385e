-- Version 11 of the store.

-- Denials:
--   access_event   denied requests that are equal share a row for a day, and go after some time; acts stay.

DROP TRIGGER access_event_kept;
CREATE TRIGGER access_event_kept BEFORE DELETE ON access_event WHEN OLD.kind = 'act'
  BEGIN SELECT RAISE(ABORT, 'acts are never deleted'); END;
CREATE INDEX access_event_by_age ON access_event (kind, at);

-- Intervals of success rates:
--   standing       the ends at 0 and at all successes are exact. The view is made again of the episode
--                  rows at the daemon's next start.

DELETE FROM standing WHERE successes IN (0, episodes);

-- Artefacts:
--   artefact_holder  who uploaded an artefact's files, and for which team ('': for none). A team may
--                    submit an artefact that it holds or submitted before, and nobody else may

CREATE TABLE artefact_holder (
  artefact TEXT NOT NULL REFERENCES artefact (hash),
  uploader TEXT NOT NULL,
  team     TEXT NOT NULL,
  PRIMARY KEY (artefact, uploader, team)
) STRICT, WITHOUT ROWID;
INSERT INTO artefact_holder SELECT artefact, uploader, team FROM upload WHERE uploader != '';

-- Secrets:
--   phase_secret     belongs to a phase of one challenge. '': the challenge is not known yet, as of a
--                    secret of an earlier version; the first that loads the phase becomes it

DROP TRIGGER phase_secret_fixed;
ALTER TABLE phase_secret ADD COLUMN challenge TEXT NOT NULL DEFAULT '';
CREATE TRIGGER phase_secret_fixed BEFORE UPDATE ON phase_secret
  WHEN OLD.challenge != '' OR NEW.phase IS NOT OLD.phase OR NEW.secret IS NOT OLD.secret OR
       NEW.created_at IS NOT OLD.created_at
  BEGIN SELECT RAISE(ABORT, 'a phase''s secret is never changed'); END;
