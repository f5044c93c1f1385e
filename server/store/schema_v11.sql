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
