-- Version 6 of the store: people, their rights, and the phases of a challenge.
--
--   team          may have been merged into another one, and may be banned
--   former_name   names that a team had before, so that they still find it
--   team_event    every act on a team: created, renamed, merged, banned, unbanned
--   member        who belongs to a team; the newest row of a team and a person is in force. Whoever
--                 submitted for a team in earlier versions is a member of it
--   token         bearer tokens, as hashes
--   access_event  requests that were denied, and acts of organisers and operators. Equal denials of
--                 one minute share a row, so that nobody can fill the disk with them
--   phase_secret  what the seeds of a phase with committed seeds follow from
--   phase_event   acts on a phase: paused, resumed, published (a frozen board), revealed (its seeds)
--   choice        the submission that a team stands with where it may choose; the newest row is in
--                 force
--   request_key   submissions and re-runs that were asked for with an Idempotency-Key
--   submission, admission, ledger   belong to a phase; '' is a track's own board
--
-- Invariants:
--   10. Team events, memberships, access events (but for their count), phase events and choices are
--       never changed or deleted.
--   11. A phase's secret is never changed.

ALTER TABLE team ADD COLUMN merged_into INTEGER REFERENCES team (id);
ALTER TABLE team ADD COLUMN banned INTEGER NOT NULL DEFAULT 0 CHECK (banned IN (0, 1));

CREATE TABLE former_name (
  name    TEXT PRIMARY KEY CHECK (length(name) > 0),
  team_id INTEGER NOT NULL REFERENCES team (id)
) STRICT;

CREATE TABLE team_event (
  id      INTEGER PRIMARY KEY AUTOINCREMENT,
  at      INTEGER NOT NULL,
  team_id INTEGER NOT NULL REFERENCES team (id),
  event   TEXT NOT NULL CHECK (event IN ('created', 'renamed', 'merged', 'banned', 'unbanned')),
  detail  TEXT NOT NULL,                 -- the former name, or the team it was merged into; else ''
  who     TEXT NOT NULL CHECK (length(who) > 0),
  why     TEXT NOT NULL
) STRICT;
CREATE INDEX team_event_by_team ON team_event (team_id, id);

CREATE TABLE member (
  id      INTEGER PRIMARY KEY AUTOINCREMENT,
  at      INTEGER NOT NULL,
  team_id INTEGER NOT NULL REFERENCES team (id),
  person  TEXT NOT NULL CHECK (length(person) > 0),   -- 'uid 1000'
  belongs INTEGER NOT NULL CHECK (belongs IN (0, 1)),
  who     TEXT NOT NULL CHECK (length(who) > 0)
) STRICT;
CREATE INDEX member_by_team ON member (team_id, person, id);
CREATE INDEX member_by_person ON member (person, team_id, id);
INSERT INTO member (at, team_id, person, belongs, who)
  SELECT min(accepted_at), team_id, accepted_by, 1, 'migration' FROM submission
    WHERE accepted_by LIKE 'uid %' GROUP BY team_id, accepted_by ORDER BY min(id);

CREATE TABLE token (
  id           INTEGER PRIMARY KEY AUTOINCREMENT,
  hash         TEXT NOT NULL UNIQUE CHECK (length(hash) = 64),   -- SHA-256 of the token's text
  role         TEXT NOT NULL CHECK (role IN ('participant', 'organiser', 'operator')),
  team_id      INTEGER REFERENCES team (id),
  label        TEXT NOT NULL,
  created_at   INTEGER NOT NULL,
  created_by   TEXT NOT NULL CHECK (length(created_by) > 0),
  expires_at   INTEGER,                  -- NULL: never
  revoked_at   INTEGER,
  revoked_by   TEXT,
  last_used_at INTEGER,                  -- to the minute
  CHECK ((role = 'participant') = (team_id IS NOT NULL)),
  CHECK ((revoked_at IS NULL) = (revoked_by IS NULL))
) STRICT;

CREATE TABLE access_event (
  id      INTEGER PRIMARY KEY AUTOINCREMENT,
  at      INTEGER NOT NULL,
  kind    TEXT NOT NULL CHECK (kind IN ('denied', 'act')),
  who     TEXT NOT NULL CHECK (length(who) > 0),  -- 'uid 1000', 'token 7', 'address 192.0.2.1'
  role    TEXT NOT NULL,
  action  TEXT NOT NULL CHECK (length(action) > 0),
  subject TEXT NOT NULL,                 -- what it was about; '' where that would be a stranger's text
  detail  TEXT NOT NULL,                 -- why it was denied, or what the act changed
  count   INTEGER NOT NULL DEFAULT 1 CHECK (count > 0)
) STRICT;

CREATE TABLE phase_secret (
  phase      TEXT PRIMARY KEY CHECK (length(phase) > 0),
  secret     BLOB NOT NULL CHECK (length(secret) = 32),
  created_at INTEGER NOT NULL
) STRICT;

CREATE TABLE phase_event (
  id    INTEGER PRIMARY KEY AUTOINCREMENT,
  at    INTEGER NOT NULL,
  phase TEXT NOT NULL,                   -- '' for 'paused' and 'resumed': all submissions
  event TEXT NOT NULL CHECK (event IN ('paused', 'resumed', 'published', 'revealed')),
  who   TEXT NOT NULL CHECK (length(who) > 0),
  why   TEXT NOT NULL
) STRICT;
CREATE INDEX phase_event_by_phase ON phase_event (phase, id);

CREATE TABLE choice (
  id         INTEGER PRIMARY KEY AUTOINCREMENT,
  at         INTEGER NOT NULL,
  team_id    INTEGER NOT NULL REFERENCES team (id),
  phase      TEXT NOT NULL,
  submission INTEGER NOT NULL REFERENCES submission (id),
  who        TEXT NOT NULL CHECK (length(who) > 0)
) STRICT;
CREATE INDEX choice_by_team ON choice (phase, team_id, id);

CREATE TABLE request_key (
  who        TEXT NOT NULL,
  key        TEXT NOT NULL,
  request    TEXT NOT NULL CHECK (length(request) = 64),   -- SHA-256 of what was asked for
  submission INTEGER NOT NULL REFERENCES submission (id),
  evaluation INTEGER NOT NULL REFERENCES evaluation (id),
  linked     INTEGER NOT NULL CHECK (linked IN (0, 1)),
  at         INTEGER NOT NULL,
  PRIMARY KEY (who, key)
) STRICT, WITHOUT ROWID;
CREATE INDEX request_key_by_age ON request_key (at);
CREATE INDEX request_key_by_caller ON request_key (who, at DESC, key);

ALTER TABLE submission ADD COLUMN phase TEXT NOT NULL DEFAULT '';
CREATE INDEX submission_by_phase ON submission (phase, id) WHERE phase != '';
ALTER TABLE admission ADD COLUMN phase TEXT NOT NULL DEFAULT '';
ALTER TABLE ledger ADD COLUMN phase TEXT NOT NULL DEFAULT '';

CREATE TRIGGER board_by_choice AFTER INSERT ON choice
  BEGIN UPDATE board_state SET changes = changes + 1; END;
CREATE TRIGGER board_by_phase AFTER INSERT ON phase_event
  BEGIN UPDATE board_state SET changes = changes + 1; END;
CREATE TRIGGER board_by_team AFTER INSERT ON team_event WHEN NEW.event != 'created'
  BEGIN UPDATE board_state SET changes = changes + 1; END;

CREATE TRIGGER team_event_fixed BEFORE UPDATE ON team_event
  BEGIN SELECT RAISE(ABORT, 'team events are never changed'); END;
CREATE TRIGGER team_event_kept BEFORE DELETE ON team_event
  BEGIN SELECT RAISE(ABORT, 'team events are never deleted'); END;
CREATE TRIGGER member_fixed BEFORE UPDATE ON member
  BEGIN SELECT RAISE(ABORT, 'memberships are never changed'); END;
CREATE TRIGGER member_kept BEFORE DELETE ON member
  BEGIN SELECT RAISE(ABORT, 'memberships are never deleted'); END;
CREATE TRIGGER access_event_fixed
  BEFORE UPDATE OF at, kind, who, role, action, subject, detail ON access_event
  BEGIN SELECT RAISE(ABORT, 'access events are never changed'); END;
CREATE TRIGGER access_event_kept BEFORE DELETE ON access_event
  BEGIN SELECT RAISE(ABORT, 'access events are never deleted'); END;
CREATE TRIGGER phase_secret_fixed BEFORE UPDATE ON phase_secret
  BEGIN SELECT RAISE(ABORT, 'a phase''s secret is never changed'); END;
CREATE TRIGGER phase_event_fixed BEFORE UPDATE ON phase_event
  BEGIN SELECT RAISE(ABORT, 'phase events are never changed'); END;
CREATE TRIGGER phase_event_kept BEFORE DELETE ON phase_event
  BEGIN SELECT RAISE(ABORT, 'phase events are never deleted'); END;
CREATE TRIGGER choice_fixed BEFORE UPDATE ON choice
  BEGIN SELECT RAISE(ABORT, 'choices are never changed'); END;
CREATE TRIGGER choice_kept BEFORE DELETE ON choice
  BEGIN SELECT RAISE(ABORT, 'choices are never deleted'); END;
