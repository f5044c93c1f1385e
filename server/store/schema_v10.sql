-- Version 10 of the store: where the leases of a cluster ran, what they used, and its nodes.
--
--   lease_run    an attempt of a lease that has ended: on which node and as which job ('' on the
--                daemon's own host), what it used, and how it ended. An attempt of an earlier version,
--                and one that a daemon did not live to see the end of, has none
--   node_event   a node of the cluster gets no more leases, or gets them again. The newest row of a
--                node is in force
--
-- Invariants:
--   15. An attempt has at most one lease_run, and neither those nor node events are ever changed or
--       deleted.
--
-- CPU time and energy are whole numbers of a thousandth, as exports hold nothing else.

CREATE TABLE lease_run (
  lease     INTEGER NOT NULL REFERENCES lease (id),
  attempt   INTEGER NOT NULL CHECK (attempt > 0),
  node      TEXT NOT NULL,
  job       TEXT NOT NULL,               -- the cluster's name for it, such as 1234_5
  began_at  INTEGER,                     -- NULL: it waited for a processor until it ended
  ended_at  INTEGER NOT NULL,
  cpu_ms    INTEGER NOT NULL CHECK (cpu_ms >= 0),     -- of all its processes
  energy_mj INTEGER CHECK (energy_mj >= 0),           -- NULL: it was not measured
  how       TEXT NOT NULL CHECK (how IN ('done', 'fault', 'returned', 'cancelled')),
  PRIMARY KEY (lease, attempt)
) STRICT, WITHOUT ROWID;

CREATE TABLE node_event (
  id    INTEGER PRIMARY KEY AUTOINCREMENT,
  at    INTEGER NOT NULL,
  node  TEXT NOT NULL CHECK (length(node) > 0),
  event TEXT NOT NULL CHECK (event IN ('drained', 'admitted')),
  who   TEXT NOT NULL CHECK (length(who) > 0),
  why   TEXT NOT NULL
) STRICT;
CREATE INDEX node_event_by_node ON node_event (node, id);

CREATE TRIGGER lease_run_fixed BEFORE UPDATE ON lease_run
  BEGIN SELECT RAISE(ABORT, 'what an attempt used is never changed'); END;
CREATE TRIGGER lease_run_kept BEFORE DELETE ON lease_run
  BEGIN SELECT RAISE(ABORT, 'what an attempt used is never deleted'); END;
CREATE TRIGGER node_event_fixed BEFORE UPDATE ON node_event
  BEGIN SELECT RAISE(ABORT, 'what was done to a node is never changed'); END;
CREATE TRIGGER node_event_kept BEFORE DELETE ON node_event
  BEGIN SELECT RAISE(ABORT, 'what was done to a node is never deleted'); END;
