-- A store of schema version 10, with configs of form 1.
BEGIN TRANSACTION;
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
INSERT INTO access_event VALUES(1,1728004620000,'denied','uid 1009','participant','see','submission 1','of another team',1);
INSERT INTO access_event VALUES(2,1728004620000,'denied','address 192.0.2.1','public','read host','','role',3);
CREATE TABLE admission (
  submission INTEGER PRIMARY KEY REFERENCES submission (id),
  team_id    INTEGER NOT NULL REFERENCES team (id),
  track      TEXT NOT NULL,
  budget     TEXT NOT NULL CHECK (budget IN ('official', 'practice')),
  day        INTEGER NOT NULL CHECK (day >= 0)
, phase TEXT NOT NULL DEFAULT '') STRICT;
INSERT INTO admission VALUES(1,1,'demo-manipulation','official',20000,'');
INSERT INTO admission VALUES(2,2,'demo-manipulation','official',20000,'');
INSERT INTO admission VALUES(3,1,'demo-manipulation','official',20000,'');
INSERT INTO admission VALUES(4,2,'demo-manipulation','official',20000,'');
INSERT INTO admission VALUES(5,2,'demo-manipulation','official',20000,'');
CREATE TABLE artefact (
  hash          TEXT PRIMARY KEY CHECK (length(hash) = 64),
  name          TEXT NOT NULL,   -- as its policy.json says
  command_json  TEXT NOT NULL,   -- array of strings
  runtimes_json TEXT NOT NULL,   -- array of names of configured runtimes
  bytes         INTEGER NOT NULL CHECK (bytes >= 0),
  files         INTEGER NOT NULL CHECK (files >= 0),
  created_at    INTEGER NOT NULL
, environment_json TEXT NOT NULL DEFAULT '{}', options_json TEXT NOT NULL DEFAULT '{}') STRICT;
INSERT INTO artefact VALUES('c7c2e19b891b7062dc266f6b92e81978d7daa3960a35a0fef0e653248a0460b3','victim','["./policy"]','[]',1,1,1728000000000,'{}','{}');
INSERT INTO artefact VALUES('81c55187a1ef6c8f83e01d3a49e5faf0675394de0239f210adfdfd14aea05e08','other','["./policy"]','[]',1,1,1728000060000,'{}','{}');
INSERT INTO artefact VALUES('239ab30d804924fd096504e1017e24d1e7dca9eac51e3a8aa7d8b776f820008f','victim','["./policy"]','[]',1,1,1728000120000,'{}','{}');
INSERT INTO artefact VALUES('cabcc58cc0c74efa757f5db42d26ddd9df22c152c298c361203648424c8056e2','other','["./policy"]','[]',1,1,1728000120000,'{}','{"extra_observations":true}');
INSERT INTO artefact VALUES('86054eaf46ab6b5994904e312a9abade429d9e82e6cfe2686945d20c366d5dad','other','["./policy"]','[]',1,1,1728000120000,'{}','{}');
CREATE TABLE board_config (
  id      INTEGER PRIMARY KEY AUTOINCREMENT,
  at      INTEGER NOT NULL,
  phase   TEXT NOT NULL,
  track   TEXT NOT NULL,
  profile TEXT NOT NULL,
  config  TEXT NOT NULL REFERENCES config (hash),
  rejudge INTEGER REFERENCES rejudge (id),   -- whose act it was; NULL: the config files changed
  who     TEXT NOT NULL CHECK (length(who) > 0)
) STRICT;
CREATE TABLE board_state (
  id      INTEGER PRIMARY KEY CHECK (id = 1),
  changes INTEGER NOT NULL
) STRICT;
INSERT INTO board_state VALUES(1,16);
CREATE TABLE choice (
  id         INTEGER PRIMARY KEY AUTOINCREMENT,
  at         INTEGER NOT NULL,
  team_id    INTEGER NOT NULL REFERENCES team (id),
  phase      TEXT NOT NULL,
  submission INTEGER NOT NULL REFERENCES submission (id),
  who        TEXT NOT NULL CHECK (length(who) > 0)
) STRICT;
INSERT INTO choice VALUES(1,1728004560000,1,'',1,'uid 1001');
CREATE TABLE config (
  hash           TEXT PRIMARY KEY CHECK (length(hash) = 64),
  track          TEXT NOT NULL,
  profile        TEXT NOT NULL,
  effective_json TEXT NOT NULL,
  created_at     INTEGER NOT NULL
) STRICT;
INSERT INTO config VALUES('fa0d77852c176878aaf0ebd88394e40b8e1ae9283c1e6444372c4c0f82f802e8','demo-manipulation','paper','{"budgets":{"cpus":1,"lease_cpu_s":12000,"lease_wall_s":24000,"memory_bytes":8589934592,"open_files":1024,"output_bytes":1048576,"overtime_s":60,"restarts":2,"scratch_bytes":1073741824,"scratch_files":100000,"startup_s":120,"step_s":1,"stray_messages":1000,"submission_bytes":4294967296,"submission_files":200000,"tasks":256,"wall_factor":10,"wrong_answers":16},"episodes_per_lease":1,"id":"demo-manipulation","profile":"paper","rules":{"actions_unclipped":false,"bounding_radius_fixed":false,"count_reset_frame":false,"drop_height_m":0.3,"end_lags_solved":false,"end_rule":"placed","friction":[1,0.005,0.0001],"friction_spread":[0.1,0.001,2e-05],"goal_centre_m":[0.4,-0.25,1.05],"goal_face_m":1.09,"goal_spread_m":[0.098,0.098,0],"half_size_m":[0.036,0.044,0.014],"hold_frames":8,"inertia":"solid_box","mass_kg":0.097,"mass_spread_kg":0.05,"max_steps":1000,"max_time_s":10,"object_point":"box_centre","one_environment":false,"peak_touch_survives_reset":false,"phantom_trials":false,"placed_axis_m":0.1,"release_height_m":0.1,"size_fixed_on_first_reset":false,"size_spread":[0.05,0.1,0.05],"solved_distance_m":0.17,"solved_goal_frames":10,"stale_first_observation":false,"start_centre_m":[-0.4,-0.25,1.05],"start_spread_m":[0.055,0.055,0],"warnings_reset_simulation":false,"world_contact":"other"},"scoring":{"boards":{"main":{"band_factor":1.1,"bands":"time","line_episodes":100,"line_successes":90}},"contact_frames":100,"force_enforced":true,"force_limit_n":1500,"full_time_s":10,"success":"placed","team":"best","time":"played"},"seeds":{"count":3,"first":100},"track":"manipulation"}',1728000000000);
CREATE TABLE delivery (
  id         INTEGER PRIMARY KEY AUTOINCREMENT,
  at         INTEGER NOT NULL,
  webhook    TEXT NOT NULL CHECK (length(webhook) > 0),   -- its name in server.json
  event      TEXT NOT NULL CHECK (length(event) > 0),
  body_json  TEXT NOT NULL,
  state      TEXT NOT NULL CHECK (state IN ('waiting', 'delivered', 'given_up')),
  attempts   INTEGER NOT NULL DEFAULT 0 CHECK (attempts >= 0),
  due_at     INTEGER NOT NULL,           -- of the next attempt
  detail     TEXT NOT NULL DEFAULT ''    -- what went wrong last
) STRICT;
CREATE TABLE episode (
  evaluation   INTEGER NOT NULL REFERENCES evaluation (id),
  idx          INTEGER NOT NULL CHECK (idx >= 0),
  lease        INTEGER NOT NULL REFERENCES lease (id),
  attempt      INTEGER NOT NULL CHECK (attempt > 0),
  seed         INTEGER NOT NULL CHECK (seed >= 0),
  outcome      TEXT NOT NULL CHECK (outcome IN
                 ('success', 'failure', 'unstable', 'init_timeout', 'step_timeout', 'wall_timeout',
                  'cpu_limit', 'memory_limit', 'process_limit', 'disk_limit', 'output_limit',
                  'protocol', 'crash')),
  reason       TEXT NOT NULL CHECK (length(reason) <= 40),
  facts_json   TEXT NOT NULL,            -- as the simulator measured them
  metrics_json TEXT NOT NULL,            -- as scoring judged them
  recorded_at  INTEGER NOT NULL,
  PRIMARY KEY (evaluation, idx),
  CHECK ((outcome = 'failure') = (reason != ''))
) STRICT, WITHOUT ROWID;
INSERT INTO episode VALUES(1,0,1,1,0,'success','','{"clipped":0,"digest":"de434d925548041f6a48b9f4866f543c6b2fb65afed557826ff5a29f5f2a75ad","end":"placed","index":0,"manipulation":{"effort_sum":0.0,"final_goal_distance":0.0,"final_hand_distance":0.0,"frames":0,"frames_arm":100,"frames_goal":0,"frames_other":0,"frames_prosthesis":100,"frames_start":0,"goal_distance_sum":0.0,"goal_only_at_end":true,"max_height":0.0,"max_touch":0.0,"peak_force":0.0,"placed":true,"reported_time":0.0,"solved":true,"solved_steps":0},"policy_cpu_s":0.0,"seed":0,"sim_time":1.0,"steps":100,"track":"manipulation","wall_s":0.0}','{"distance_m":null,"effort":0.0,"effort_sum":0.0,"pain":null,"pain_sum":null,"peak_force_n":0.0,"reported_time_s":0.0,"success":1,"time_s":1.0}',1728000005000);
INSERT INTO episode VALUES(1,1,1,1,10,'success','','{"clipped":0,"digest":"5ef39de71bacf3ffc75ca82d6447fd739ddf9f44def5e95c7b671fbbfaae7506","end":"placed","index":1,"manipulation":{"effort_sum":0.0,"final_goal_distance":0.0,"final_hand_distance":0.0,"frames":0,"frames_arm":100,"frames_goal":0,"frames_other":0,"frames_prosthesis":100,"frames_start":0,"goal_distance_sum":0.0,"goal_only_at_end":true,"max_height":0.0,"max_touch":0.0,"peak_force":0.0,"placed":true,"reported_time":0.0,"solved":true,"solved_steps":0},"policy_cpu_s":0.0,"seed":10,"sim_time":1.0,"steps":100,"track":"manipulation","wall_s":0.0}','{"distance_m":null,"effort":0.0,"effort_sum":0.0,"pain":null,"pain_sum":null,"peak_force_n":0.0,"reported_time_s":0.0,"success":1,"time_s":1.0}',1728000010000);
INSERT INTO episode VALUES(1,2,2,1,20,'success','','{"clipped":0,"digest":"769893e339e27c020dc3b7e0b0a1c79de640095e06e1fe4dc9381e0dbb89fa7c","end":"placed","index":2,"manipulation":{"effort_sum":0.0,"final_goal_distance":0.0,"final_hand_distance":0.0,"frames":0,"frames_arm":100,"frames_goal":0,"frames_other":0,"frames_prosthesis":100,"frames_start":0,"goal_distance_sum":0.0,"goal_only_at_end":true,"max_height":0.0,"max_touch":0.0,"peak_force":0.0,"placed":true,"reported_time":0.0,"solved":true,"solved_steps":0},"policy_cpu_s":0.0,"seed":20,"sim_time":1.0,"steps":100,"track":"manipulation","wall_s":0.0}','{"distance_m":null,"effort":0.0,"effort_sum":0.0,"pain":null,"pain_sum":null,"peak_force_n":0.0,"reported_time_s":0.0,"success":1,"time_s":1.0}',1728000005000);
INSERT INTO episode VALUES(1,3,2,1,30,'success','','{"clipped":0,"digest":"da12a9d9a53af46e7682e122e2dc34812e0cc16df5c3548bd015d884085babd0","end":"placed","index":3,"manipulation":{"effort_sum":0.0,"final_goal_distance":0.0,"final_hand_distance":0.0,"frames":0,"frames_arm":100,"frames_goal":0,"frames_other":0,"frames_prosthesis":100,"frames_start":0,"goal_distance_sum":0.0,"goal_only_at_end":true,"max_height":0.0,"max_touch":0.0,"peak_force":0.0,"placed":true,"reported_time":0.0,"solved":true,"solved_steps":0},"policy_cpu_s":0.0,"seed":30,"sim_time":1.0,"steps":100,"track":"manipulation","wall_s":0.0}','{"distance_m":null,"effort":0.0,"effort_sum":0.0,"pain":null,"pain_sum":null,"peak_force_n":0.0,"reported_time_s":0.0,"success":1,"time_s":1.0}',1728000010000);
INSERT INTO episode VALUES(1,4,3,1,40,'success','','{"clipped":0,"digest":"056ac3f282cb24230e6040ec1f0f3c20ce1f6aa97a36dcd130e697e3b4530367","end":"placed","index":4,"manipulation":{"effort_sum":0.0,"final_goal_distance":0.0,"final_hand_distance":0.0,"frames":0,"frames_arm":100,"frames_goal":0,"frames_other":0,"frames_prosthesis":100,"frames_start":0,"goal_distance_sum":0.0,"goal_only_at_end":true,"max_height":0.0,"max_touch":0.0,"peak_force":0.0,"placed":true,"reported_time":0.0,"solved":true,"solved_steps":0},"policy_cpu_s":0.0,"seed":40,"sim_time":1.0,"steps":100,"track":"manipulation","wall_s":0.0}','{"distance_m":null,"effort":0.0,"effort_sum":0.0,"pain":null,"pain_sum":null,"peak_force_n":0.0,"reported_time_s":0.0,"success":1,"time_s":1.0}',1728000015000);
INSERT INTO episode VALUES(1,5,3,1,50,'success','','{"clipped":0,"digest":"0299b26def3925e63c996be41a67117338ff496a84405b9eea5fdb577158b8c5","end":"placed","index":5,"manipulation":{"effort_sum":0.0,"final_goal_distance":0.0,"final_hand_distance":0.0,"frames":0,"frames_arm":100,"frames_goal":0,"frames_other":0,"frames_prosthesis":100,"frames_start":0,"goal_distance_sum":0.0,"goal_only_at_end":true,"max_height":0.0,"max_touch":0.0,"peak_force":0.0,"placed":true,"reported_time":0.0,"solved":true,"solved_steps":0},"policy_cpu_s":0.0,"seed":50,"sim_time":1.0,"steps":100,"track":"manipulation","wall_s":0.0}','{"distance_m":null,"effort":0.0,"effort_sum":0.0,"pain":null,"pain_sum":null,"peak_force_n":0.0,"reported_time_s":0.0,"success":1,"time_s":1.0}',1728000020000);
INSERT INTO episode VALUES(2,0,4,1,1,'failure','time','{"clipped":0,"digest":"177cbc3b567cb4f364a81a9c6a365c1f7e99f04e8ba11d562c3de6b5795eb9a0","end":"time","index":0,"manipulation":{"effort_sum":0.0,"final_goal_distance":0.0,"final_hand_distance":0.0,"frames":0,"frames_arm":100,"frames_goal":0,"frames_other":0,"frames_prosthesis":100,"frames_start":0,"goal_distance_sum":0.0,"goal_only_at_end":false,"max_height":0.0,"max_touch":0.0,"peak_force":0.0,"placed":false,"reported_time":0.0,"solved":false,"solved_steps":0},"policy_cpu_s":0.0,"seed":1,"sim_time":1.0,"steps":100,"track":"manipulation","wall_s":0.0}','{"distance_m":null,"effort":0.0,"effort_sum":0.0,"pain":null,"pain_sum":null,"peak_force_n":0.0,"reported_time_s":0.0,"success":0,"time_s":10.0}',1728000065000);
INSERT INTO episode VALUES(2,1,4,1,11,'failure','time','{"clipped":0,"digest":"6d62745921e501a0ef02de00fc12331a47d2009362ae6e2b4dd3c9e46c877d32","end":"time","index":1,"manipulation":{"effort_sum":0.0,"final_goal_distance":0.0,"final_hand_distance":0.0,"frames":0,"frames_arm":100,"frames_goal":0,"frames_other":0,"frames_prosthesis":100,"frames_start":0,"goal_distance_sum":0.0,"goal_only_at_end":false,"max_height":0.0,"max_touch":0.0,"peak_force":0.0,"placed":false,"reported_time":0.0,"solved":false,"solved_steps":0},"policy_cpu_s":0.0,"seed":11,"sim_time":1.0,"steps":100,"track":"manipulation","wall_s":0.0}','{"distance_m":null,"effort":0.0,"effort_sum":0.0,"pain":null,"pain_sum":null,"peak_force_n":0.0,"reported_time_s":0.0,"success":0,"time_s":10.0}',1728000070000);
INSERT INTO episode VALUES(2,2,5,1,21,'failure','time','{"clipped":0,"digest":"8b4e6c49b87feb9667fbc0ec6a448911f90d0589d359801862cc136fbf586b72","end":"time","index":2,"manipulation":{"effort_sum":0.0,"final_goal_distance":0.0,"final_hand_distance":0.0,"frames":0,"frames_arm":100,"frames_goal":0,"frames_other":0,"frames_prosthesis":100,"frames_start":0,"goal_distance_sum":0.0,"goal_only_at_end":false,"max_height":0.0,"max_touch":0.0,"peak_force":0.0,"placed":false,"reported_time":0.0,"solved":false,"solved_steps":0},"policy_cpu_s":0.0,"seed":21,"sim_time":1.0,"steps":100,"track":"manipulation","wall_s":0.0}','{"distance_m":null,"effort":0.0,"effort_sum":0.0,"pain":null,"pain_sum":null,"peak_force_n":0.0,"reported_time_s":0.0,"success":0,"time_s":10.0}',1728000065000);
INSERT INTO episode VALUES(2,3,5,1,31,'failure','time','{"clipped":0,"digest":"6fa7d5b4e8f0082589ea57f8d8408bdeb5b71c04c9958b1aaa98f3f77995e2cc","end":"time","index":3,"manipulation":{"effort_sum":0.0,"final_goal_distance":0.0,"final_hand_distance":0.0,"frames":0,"frames_arm":100,"frames_goal":0,"frames_other":0,"frames_prosthesis":100,"frames_start":0,"goal_distance_sum":0.0,"goal_only_at_end":false,"max_height":0.0,"max_touch":0.0,"peak_force":0.0,"placed":false,"reported_time":0.0,"solved":false,"solved_steps":0},"policy_cpu_s":0.0,"seed":31,"sim_time":1.0,"steps":100,"track":"manipulation","wall_s":0.0}','{"distance_m":null,"effort":0.0,"effort_sum":0.0,"pain":null,"pain_sum":null,"peak_force_n":0.0,"reported_time_s":0.0,"success":0,"time_s":10.0}',1728000070000);
INSERT INTO episode VALUES(2,4,6,1,41,'failure','time','{"clipped":0,"digest":"4a2055c058988c42630311a22fc784685490205af8ca2043058d0c254b6dab8f","end":"time","index":4,"manipulation":{"effort_sum":0.0,"final_goal_distance":0.0,"final_hand_distance":0.0,"frames":0,"frames_arm":100,"frames_goal":0,"frames_other":0,"frames_prosthesis":100,"frames_start":0,"goal_distance_sum":0.0,"goal_only_at_end":false,"max_height":0.0,"max_touch":0.0,"peak_force":0.0,"placed":false,"reported_time":0.0,"solved":false,"solved_steps":0},"policy_cpu_s":0.0,"seed":41,"sim_time":1.0,"steps":100,"track":"manipulation","wall_s":0.0}','{"distance_m":null,"effort":0.0,"effort_sum":0.0,"pain":null,"pain_sum":null,"peak_force_n":0.0,"reported_time_s":0.0,"success":0,"time_s":10.0}',1728000075000);
INSERT INTO episode VALUES(2,5,6,1,51,'failure','time','{"clipped":0,"digest":"df382f84027859acb7c0f8da723b4e5c47f00b0502eed0a872aa3ec91beeaa33","end":"time","index":5,"manipulation":{"effort_sum":0.0,"final_goal_distance":0.0,"final_hand_distance":0.0,"frames":0,"frames_arm":100,"frames_goal":0,"frames_other":0,"frames_prosthesis":100,"frames_start":0,"goal_distance_sum":0.0,"goal_only_at_end":false,"max_height":0.0,"max_touch":0.0,"peak_force":0.0,"placed":false,"reported_time":0.0,"solved":false,"solved_steps":0},"policy_cpu_s":0.0,"seed":51,"sim_time":1.0,"steps":100,"track":"manipulation","wall_s":0.0}','{"distance_m":null,"effort":0.0,"effort_sum":0.0,"pain":null,"pain_sum":null,"peak_force_n":0.0,"reported_time_s":0.0,"success":0,"time_s":10.0}',1728000080000);
INSERT INTO episode VALUES(3,0,7,1,2,'success','','{"clipped":0,"digest":"d21c197cb11bd9d532497c8cb7c1ce1e22f0b6a083457b4add8d5566dd37357b","end":"placed","index":0,"manipulation":{"effort_sum":0.0,"final_goal_distance":0.0,"final_hand_distance":0.0,"frames":0,"frames_arm":100,"frames_goal":0,"frames_other":0,"frames_prosthesis":100,"frames_start":0,"goal_distance_sum":0.0,"goal_only_at_end":true,"max_height":0.0,"max_touch":0.0,"peak_force":0.0,"placed":true,"reported_time":0.0,"solved":true,"solved_steps":0},"policy_cpu_s":0.0,"seed":2,"sim_time":1.0,"steps":100,"track":"manipulation","wall_s":0.0}','{"distance_m":null,"effort":0.0,"effort_sum":0.0,"pain":null,"pain_sum":null,"peak_force_n":0.0,"reported_time_s":0.0,"success":1,"time_s":1.0}',1728000125000);
INSERT INTO episode VALUES(3,2,8,1,22,'success','','{"clipped":0,"digest":"fa53d636444c4fdd716bb67241397b4e12782bf417cb8e97446fb47f47f880e6","end":"placed","index":2,"manipulation":{"effort_sum":0.0,"final_goal_distance":0.0,"final_hand_distance":0.0,"frames":0,"frames_arm":100,"frames_goal":0,"frames_other":0,"frames_prosthesis":100,"frames_start":0,"goal_distance_sum":0.0,"goal_only_at_end":true,"max_height":0.0,"max_touch":0.0,"peak_force":0.0,"placed":true,"reported_time":0.0,"solved":true,"solved_steps":0},"policy_cpu_s":0.0,"seed":22,"sim_time":1.0,"steps":100,"track":"manipulation","wall_s":0.0}','{"distance_m":null,"effort":0.0,"effort_sum":0.0,"pain":null,"pain_sum":null,"peak_force_n":0.0,"reported_time_s":0.0,"success":1,"time_s":1.0}',1728000125000);
CREATE TABLE episode_details (
  id           INTEGER PRIMARY KEY,
  evaluation   INTEGER NOT NULL,
  idx          INTEGER NOT NULL,
  details_json TEXT NOT NULL,
  UNIQUE (evaluation, idx),
  FOREIGN KEY (evaluation, idx) REFERENCES episode (evaluation, idx)
) STRICT;
INSERT INTO episode_details VALUES(1,1,0,'{"first_contact_time":0.0}');
INSERT INTO episode_details VALUES(2,1,1,'{"first_contact_time":0.25}');
INSERT INTO episode_details VALUES(3,1,2,'{"first_contact_time":0.5}');
INSERT INTO episode_details VALUES(4,1,3,'{"first_contact_time":0.75}');
INSERT INTO episode_details VALUES(5,1,4,'{"first_contact_time":1.0}');
INSERT INTO episode_details VALUES(6,1,5,'{"first_contact_time":1.25}');
CREATE TABLE evaluation (
  id           INTEGER PRIMARY KEY AUTOINCREMENT,
  submission   INTEGER NOT NULL REFERENCES submission (id),
  kind         TEXT NOT NULL CHECK (kind IN ('original', 'rerun', 'rejudge')),
  first        INTEGER NOT NULL CHECK (first >= 0),
  last         INTEGER NOT NULL CHECK (last >= first),
  state        TEXT NOT NULL CHECK (state IN
                 ('queued', 'running', 'done', 'failed', 'cancelled', 'grader_error')),
  reason       TEXT NOT NULL DEFAULT '',      -- why it ended without a score
  grader_json  TEXT NOT NULL,                 -- the build that plays it
  results_hash TEXT,                          -- over the canonical rows, once it ended
  created_at   INTEGER NOT NULL,
  started_at   INTEGER,
  finished_at  INTEGER, config TEXT REFERENCES config (hash), seeds TEXT REFERENCES seed_list (hash),
  CHECK ((state IN ('queued', 'running')) = (finished_at IS NULL)),
  CHECK (state != 'running' OR started_at IS NOT NULL)
) STRICT;
INSERT INTO evaluation VALUES(1,1,'original',0,5,'done','','{}','718b8471ee981e70ef6691f9abdff99f77e95fef45f303bd5bb352bc1d731a06',1728000000000,1728000000000,1728000020000,NULL,NULL);
INSERT INTO evaluation VALUES(2,2,'original',0,5,'done','','{}','537f9a32b6b46483c139e2dc6ae340fc64e583e37756ddf4a7d555aeb322a297',1728000060000,1728000060000,1728000080000,NULL,NULL);
INSERT INTO evaluation VALUES(3,3,'original',0,3,'running','','{}',NULL,1728000120000,1728000120000,NULL,NULL,NULL);
INSERT INTO evaluation VALUES(4,4,'original',0,3,'queued','','{}',NULL,1728000120000,NULL,NULL,NULL,NULL);
INSERT INTO evaluation VALUES(5,5,'original',0,1,'queued','','{}',NULL,1728000120000,NULL,NULL,NULL,NULL);
CREATE TABLE former_name (
  name    TEXT PRIMARY KEY CHECK (length(name) > 0),
  team_id INTEGER NOT NULL REFERENCES team (id)
) STRICT;
INSERT INTO former_name VALUES('third',3);
CREATE TABLE lease (
  id          INTEGER PRIMARY KEY AUTOINCREMENT,
  evaluation  INTEGER NOT NULL REFERENCES evaluation (id),
  first       INTEGER NOT NULL CHECK (first >= 0),
  last        INTEGER NOT NULL CHECK (last >= first),
  state       TEXT NOT NULL CHECK (state IN ('pending', 'running', 'done', 'failed', 'cancelled')),
  attempt     INTEGER NOT NULL DEFAULT 0 CHECK (attempt >= 0),            -- starts so far
  faults      INTEGER NOT NULL DEFAULT 0 CHECK (faults BETWEEN 0 AND attempt),  -- the grader's
  detail      TEXT NOT NULL DEFAULT '',  -- what went wrong last
  slot        INTEGER,
  owner       TEXT,                      -- the daemon that runs it
  started_at  INTEGER,
  deadline_at INTEGER,
  finished_at INTEGER,
  output_json TEXT,                      -- how the last attempt that reached its end went
  UNIQUE (evaluation, first),
  CHECK ((state = 'running') = (slot IS NOT NULL AND owner IS NOT NULL AND
                                started_at IS NOT NULL AND deadline_at IS NOT NULL)),
  CHECK (state = 'running' OR (slot IS NULL AND owner IS NULL AND deadline_at IS NULL)),
  CHECK ((state IN ('pending', 'running')) = (finished_at IS NULL))
) STRICT;
INSERT INTO lease VALUES(1,1,0,1,'done',1,0,'',NULL,NULL,NULL,NULL,1728000010000,'{"peak_memory_bytes":0,"policy_cpu_s":0.0,"stderr_tail":"","stderr_truncated":false,"stdout_tail":"","stdout_truncated":false,"wall_s":0.0}');
INSERT INTO lease VALUES(2,1,2,3,'done',1,0,'',NULL,NULL,NULL,NULL,1728000010000,'{"peak_memory_bytes":0,"policy_cpu_s":0.0,"stderr_tail":"","stderr_truncated":false,"stdout_tail":"","stdout_truncated":false,"wall_s":0.0}');
INSERT INTO lease VALUES(3,1,4,5,'done',1,0,'',NULL,NULL,NULL,NULL,1728000020000,'{"peak_memory_bytes":0,"policy_cpu_s":0.0,"stderr_tail":"","stderr_truncated":false,"stdout_tail":"","stdout_truncated":false,"wall_s":0.0}');
INSERT INTO lease VALUES(4,2,0,1,'done',1,0,'',NULL,NULL,NULL,NULL,1728000070000,'{"peak_memory_bytes":0,"policy_cpu_s":0.0,"stderr_tail":"","stderr_truncated":false,"stdout_tail":"","stdout_truncated":false,"wall_s":0.0}');
INSERT INTO lease VALUES(5,2,2,3,'done',1,0,'',NULL,NULL,NULL,NULL,1728000070000,'{"peak_memory_bytes":0,"policy_cpu_s":0.0,"stderr_tail":"","stderr_truncated":false,"stdout_tail":"","stdout_truncated":false,"wall_s":0.0}');
INSERT INTO lease VALUES(6,2,4,5,'done',1,0,'',NULL,NULL,NULL,NULL,1728000080000,'{"peak_memory_bytes":0,"policy_cpu_s":0.0,"stderr_tail":"","stderr_truncated":false,"stdout_tail":"","stdout_truncated":false,"wall_s":0.0}');
INSERT INTO lease VALUES(7,3,0,1,'running',1,0,'',0,'daemon 11594',1728000120000,1728024180000,NULL,NULL);
INSERT INTO lease VALUES(8,3,2,3,'running',1,0,'',1,'daemon 11594',1728000120000,1728024180000,NULL,NULL);
INSERT INTO lease VALUES(9,4,0,1,'pending',0,0,'',NULL,NULL,NULL,NULL,NULL,NULL);
INSERT INTO lease VALUES(10,4,2,3,'pending',0,0,'',NULL,NULL,NULL,NULL,NULL,NULL);
INSERT INTO lease VALUES(11,5,0,1,'pending',0,0,'',NULL,NULL,NULL,NULL,NULL,NULL);
CREATE TABLE ledger (
  id         INTEGER PRIMARY KEY AUTOINCREMENT,
  at         INTEGER NOT NULL,
  day        INTEGER NOT NULL CHECK (day >= 0),   -- the day that it counts for
  team_id    INTEGER NOT NULL REFERENCES team (id),
  track      TEXT NOT NULL,
  budget     TEXT NOT NULL CHECK (budget IN ('official', 'practice', 'failed')),
  entry      TEXT NOT NULL CHECK (entry IN ('charge', 'refund', 'grant')),
  amount     INTEGER NOT NULL CHECK (amount > 0),
  submission INTEGER REFERENCES submission (id),  -- NULL: a grant, or an upload that was refused
  who        TEXT NOT NULL CHECK (length(who) > 0),
  why        TEXT NOT NULL CHECK (length(why) > 0), phase TEXT NOT NULL DEFAULT '',
  CHECK (entry != 'refund' OR submission IS NOT NULL)
) STRICT;
INSERT INTO ledger VALUES(1,1728000005000,20000,1,'demo-manipulation','official','charge',1,1,'daemon','episode 0 ended as success','');
INSERT INTO ledger VALUES(7,1728000065000,20000,2,'demo-manipulation','official','charge',1,2,'daemon','episode 0 ended as failure','');
INSERT INTO ledger VALUES(13,1728000125000,20000,1,'demo-manipulation','official','charge',1,3,'daemon','episode 0 ended as success','');
INSERT INTO ledger VALUES(15,1728000127000,20000,1,'demo-manipulation','official','grant',1,NULL,'uid 0','the grid was down','');
CREATE TABLE mark (
  id         INTEGER PRIMARY KEY AUTOINCREMENT,
  at         INTEGER NOT NULL,
  submission INTEGER NOT NULL REFERENCES submission (id),
  mark       TEXT NOT NULL CHECK (mark IN ('hidden', 'disqualified', 'baseline')),
  set_to     INTEGER NOT NULL CHECK (set_to IN (0, 1)),
  who        TEXT NOT NULL CHECK (length(who) > 0),
  why        TEXT NOT NULL
) STRICT;
INSERT INTO mark VALUES(1,1728000127000,1,'baseline',1,'uid 0','ours');
CREATE TABLE member (
  id      INTEGER PRIMARY KEY AUTOINCREMENT,
  at      INTEGER NOT NULL,
  team_id INTEGER NOT NULL REFERENCES team (id),
  person  TEXT NOT NULL CHECK (length(person) > 0),   -- 'uid 1000'
  belongs INTEGER NOT NULL CHECK (belongs IN (0, 1)),
  who     TEXT NOT NULL CHECK (length(who) > 0)
) STRICT;
INSERT INTO member VALUES(1,1728000000000,1,'uid 1001',1,'migration');
INSERT INTO member VALUES(2,1728000060000,2,'uid 1003',1,'migration');
INSERT INTO member VALUES(3,1728000120000,1,'uid 1002',1,'migration');
INSERT INTO member VALUES(4,1728003660000,2,'uid 1004',1,'uid 0');
INSERT INTO member VALUES(5,1728003720000,1,'uid 1002',0,'uid 0');
CREATE TABLE meta (
  key   TEXT PRIMARY KEY,
  value BLOB NOT NULL            -- 'policy_secret': 32 random bytes, made with the store
) STRICT;
INSERT INTO meta VALUES('policy_secret',X'e26450750db4a6de6f45c34eb067290f02b0c96f35e89f5c049d35fa046cf208');
INSERT INTO meta VALUES('team_looks',X'312f37322e31');
INSERT INTO meta VALUES('record_backfill',X'646f6e65');
CREATE TABLE phase_event (
  id    INTEGER PRIMARY KEY AUTOINCREMENT,
  at    INTEGER NOT NULL,
  phase TEXT NOT NULL,                   -- '' for 'paused' and 'resumed': all submissions
  event TEXT NOT NULL CHECK (event IN ('paused', 'resumed', 'published', 'revealed')),
  who   TEXT NOT NULL CHECK (length(who) > 0),
  why   TEXT NOT NULL
) STRICT;
INSERT INTO phase_event VALUES(1,1728004380000,'final','paused','uid 0','an attack');
INSERT INTO phase_event VALUES(2,1728004440000,'final','resumed','uid 0','it is over');
INSERT INTO phase_event VALUES(3,1728004500000,'final','revealed','uid 0','the end');
CREATE TABLE phase_secret (
  phase      TEXT PRIMARY KEY CHECK (length(phase) > 0),
  secret     BLOB NOT NULL CHECK (length(secret) = 32),
  created_at INTEGER NOT NULL
) STRICT;
INSERT INTO phase_secret VALUES('final',X'be3fbf309066c575d0dfcc74435eb4345af0412dcfc85421b640e5db3acc8f2b',1728004320000);
CREATE TABLE record (
  id         INTEGER PRIMARY KEY CHECK (id >= 0),
  at         INTEGER NOT NULL,
  kind       TEXT NOT NULL CHECK (length(kind) > 0),
  evaluation INTEGER,                    -- that the entry is about; NULL: none
  entry_json TEXT NOT NULL,              -- canonical
  chain      TEXT NOT NULL CHECK (length(chain) = 64)
) STRICT;
INSERT INTO record VALUES(0,1728000000000,'accepted',NULL,'{"artefact":"6ff860807454dd999852f8b091f9874ea53e20b31130741f2b50eb2b2ca66b7f","at":"2024-10-04T00:00:00.000Z","backfilled":true,"config":"fa0d77852c176878aaf0ebd88394e40b8e1ae9283c1e6444372c4c0f82f802e8","evaluation":1,"kind":"accepted","phase":null,"profile":"paper","submission":1,"team":"victim","team_id":1,"track":"demo-manipulation"}','6af18a710f4cbf2391433730d5b0f22fdd11225a31120ba9b13372b2d7e0358b');
INSERT INTO record VALUES(1,1728000020000,'graded',1,'{"at":"2024-10-04T00:00:20.000Z","backfilled":true,"config":"fa0d77852c176878aaf0ebd88394e40b8e1ae9283c1e6444372c4c0f82f802e8","evaluation":1,"grader":"44136fa355b3678a1146ad16f7e8649e94fb4fc21fe77e8310c060f61caaff8a","kind":"graded","rejudge":null,"repetition":null,"results":"718b8471ee981e70ef6691f9abdff99f77e95fef45f303bd5bb352bc1d731a06","seeds":"b3785f633e465cfbdb46548dc6f98afded356dd543ba409e0113b9180997a97d","state":"graded","submission":1}','1bf4844ffeba2157252e83848487e3f20670624f8621339c491ed5a157339562');
INSERT INTO record VALUES(2,1728000060000,'accepted',NULL,'{"artefact":"56fee7a5009b1ab477e55bf268a2a961b305f263752b2fd4c5b02aa4c80f5f94","at":"2024-10-04T00:01:00.000Z","backfilled":true,"config":"fa0d77852c176878aaf0ebd88394e40b8e1ae9283c1e6444372c4c0f82f802e8","evaluation":2,"kind":"accepted","phase":null,"profile":"paper","submission":2,"team":"other","team_id":2,"track":"demo-manipulation"}','f7a083f1bae9cc1ab2fe8a2287131cea00a55d8d97800d473da297771a1c6b25');
INSERT INTO record VALUES(3,1728000080000,'graded',2,'{"at":"2024-10-04T00:01:20.000Z","backfilled":true,"config":"fa0d77852c176878aaf0ebd88394e40b8e1ae9283c1e6444372c4c0f82f802e8","evaluation":2,"grader":"44136fa355b3678a1146ad16f7e8649e94fb4fc21fe77e8310c060f61caaff8a","kind":"graded","rejudge":null,"repetition":null,"results":"537f9a32b6b46483c139e2dc6ae340fc64e583e37756ddf4a7d555aeb322a297","seeds":"5708d219550e515e957055b3054db27138a591e594d0ee4c957f7ccd77fd066f","state":"graded","submission":2}','5fdbc5ce1fc5566fde56388c25e0de51792ee5ada26551476b303fc86ec675a5');
INSERT INTO record VALUES(4,1728000120000,'accepted',NULL,'{"artefact":"d28f65a7f85543c044cbf8a8db46c94123765ae68d3e9c04a4d6778e7e7f1473","at":"2024-10-04T00:02:00.000Z","backfilled":true,"config":"fa0d77852c176878aaf0ebd88394e40b8e1ae9283c1e6444372c4c0f82f802e8","evaluation":3,"kind":"accepted","phase":null,"profile":"paper","submission":3,"team":"victim","team_id":1,"track":"demo-manipulation"}','c5c53fbc63bbcef4d2f8dfab14e4329d089a2573559dfca93f543fd7eea8f306');
INSERT INTO record VALUES(5,1728000120000,'accepted',NULL,'{"artefact":"2dc58eb298b90b97ac26b0b1a512276462e3a749dcaba7040302839db3f9cfc7","at":"2024-10-04T00:02:00.000Z","backfilled":true,"config":"fa0d77852c176878aaf0ebd88394e40b8e1ae9283c1e6444372c4c0f82f802e8","evaluation":4,"kind":"accepted","phase":null,"profile":"paper","submission":4,"team":"other","team_id":2,"track":"demo-manipulation"}','7e00f4772498231aef849c7e645e7c4ca78ed96f3ee7452123fa3b4a5228dc57');
INSERT INTO record VALUES(6,1728000120000,'accepted',NULL,'{"artefact":"377214c23abd2281f99e72a8aeb62ce30fd01e836ef9cb77d8567d31cceb6346","at":"2024-10-04T00:02:00.000Z","backfilled":true,"config":"fa0d77852c176878aaf0ebd88394e40b8e1ae9283c1e6444372c4c0f82f802e8","evaluation":5,"kind":"accepted","phase":null,"profile":"paper","submission":5,"team":"other","team_id":2,"track":"demo-manipulation"}','b096cb13ba472e6204df44fd20fbf5111e818478c8a5ea1e8e653f11b694fbda');
INSERT INTO record VALUES(7,1728000127000,'marked',NULL,'{"at":"2024-10-04T00:02:07.000Z","backfilled":true,"kind":"marked","mark":"baseline","set":true,"submission":1}','9cf15c8d75f16d0f81c0111b58e2bc920e441d8b8ef3e83b34a91311ced83eef');
INSERT INTO record VALUES(8,1728003780000,'team',NULL,'{"at":"2024-10-04T01:03:00.000Z","backfilled":true,"event":"created","kind":"team","team":"third","team_id":3}','5cba28bc4b78322964d0af50189baab8e1320adf4522cb145c101c79fb2b1380');
INSERT INTO record VALUES(9,1728003840000,'team',NULL,'{"at":"2024-10-04T01:04:00.000Z","backfilled":true,"event":"renamed","kind":"team","team":"last","team_id":3}','be25ae8eef12f38f3125973ba1f75e4fc70de776385c9abf83b1e96e70dcf0f3');
INSERT INTO record VALUES(10,1728003900000,'team',NULL,'{"at":"2024-10-04T01:05:00.000Z","backfilled":true,"event":"created","kind":"team","team":"fourth","team_id":4}','29fd0d18ed5e4b4bfa2d8d9ce97b77db784164c3fc391610f941efe665b313b7');
INSERT INTO record VALUES(11,1728003960000,'team',NULL,'{"at":"2024-10-04T01:06:00.000Z","backfilled":true,"event":"banned","kind":"team","team":"fourth","team_id":4}','3c83093a7baa3f6a20969156c5ff6a43d4b0bf5bc3323efe132793a817b0176f');
INSERT INTO record VALUES(12,1728004020000,'team',NULL,'{"at":"2024-10-04T01:07:00.000Z","backfilled":true,"event":"created","kind":"team","team":"fifth","team_id":5}','b927de83e4d9e9da27ec6f09a101da5e306e4af1b517e1563fd6a8d6add57d11');
INSERT INTO record VALUES(13,1728004080000,'team',NULL,'{"at":"2024-10-04T01:08:00.000Z","backfilled":true,"event":"merged","into":3,"kind":"team","team":"fifth","team_id":5}','a2dea53bfe8a531e46f6bcd3038dc43b95f9d5d52148159654f0ecd7f7119cef');
INSERT INTO record VALUES(14,1728004320000,'commitment',NULL,'{"at":"2024-10-04T01:12:00.000Z","backfilled":true,"commitment":"e1b9927f13b00d1831440122775917ed8e2da00f8e3fcea83519604496f341f4","kind":"commitment","phase":"final"}','40e40a37b320995c0e4edc07465bc28ca204ff4a1ecb19971a8483199c201430');
INSERT INTO record VALUES(15,1728004380000,'phase',NULL,'{"at":"2024-10-04T01:13:00.000Z","backfilled":true,"event":"paused","kind":"phase","phase":"final"}','967457422f0632db143b73895d59a6216976c973e4a538cdc14af41c56f72898');
INSERT INTO record VALUES(16,1728004440000,'phase',NULL,'{"at":"2024-10-04T01:14:00.000Z","backfilled":true,"event":"resumed","kind":"phase","phase":"final"}','06eb3ec960636793972b26ea7e32e99ee6b4bac556e712038b08319a7d41c9d5');
INSERT INTO record VALUES(17,1728004500000,'phase',NULL,'{"at":"2024-10-04T01:15:00.000Z","backfilled":true,"event":"revealed","kind":"phase","phase":"final","secret":"be3fbf309066c575d0dfcc74435eb4345af0412dcfc85421b640e5db3acc8f2b"}','5ae4aaecdfc53573b90b8ca21da78302038a933da39e76b12e1b8bae7fd7f4ce');
INSERT INTO record VALUES(18,1728004560000,'chosen',NULL,'{"at":"2024-10-04T01:16:00.000Z","backfilled":true,"kind":"chosen","submission":1}','40f52d00ff45b53f066ddd3efdeffd968af1bade7ddb0c437b83a760deba2dbc');
CREATE TABLE rejudge (
  id          INTEGER PRIMARY KEY AUTOINCREMENT,
  at          INTEGER NOT NULL,
  purpose     TEXT NOT NULL CHECK (purpose IN ('rules', 'seeds')),
  phase       TEXT NOT NULL,             -- '': the track's own board
  track       TEXT NOT NULL,
  profile     TEXT NOT NULL,
  from_config TEXT NOT NULL REFERENCES config (hash),
  to_config   TEXT NOT NULL REFERENCES config (hash),
  seeds       TEXT NOT NULL REFERENCES seed_list (hash),
  method      TEXT NOT NULL CHECK (method IN ('auto', 'facts', 'play')),
  repeats     INTEGER NOT NULL CHECK (repeats BETWEEN 1 AND 20),
  who         TEXT NOT NULL CHECK (length(who) > 0),
  why         TEXT NOT NULL CHECK (length(why) > 0)
) STRICT;
CREATE TABLE rejudge_event (
  id            INTEGER PRIMARY KEY AUTOINCREMENT,
  at            INTEGER NOT NULL,
  rejudge       INTEGER NOT NULL REFERENCES rejudge (id),
  event         TEXT NOT NULL CHECK (event IN ('created', 'applied', 'dropped')),
  who           TEXT NOT NULL CHECK (length(who) > 0),
  why           TEXT NOT NULL CHECK (length(why) > 0),
  document_json TEXT NOT NULL,           -- canonical
  signature     TEXT NOT NULL CHECK (length(signature) = 128)
) STRICT;
CREATE TABLE rejudge_item (
  rejudge    INTEGER NOT NULL REFERENCES rejudge (id),
  submission INTEGER NOT NULL REFERENCES submission (id),
  repetition INTEGER NOT NULL CHECK (repetition >= 1),
  source     INTEGER NOT NULL REFERENCES evaluation (id),
  method     TEXT NOT NULL CHECK (method IN ('facts', 'play')),
  evaluation INTEGER NOT NULL UNIQUE REFERENCES evaluation (id),
  PRIMARY KEY (rejudge, submission, repetition)
) STRICT, WITHOUT ROWID;
CREATE TABLE removal (
  id    INTEGER PRIMARY KEY AUTOINCREMENT,
  at    INTEGER NOT NULL,
  kind  TEXT NOT NULL CHECK (kind IN ('artefact', 'log')),
  name  TEXT NOT NULL CHECK (length(name) > 0),   -- its hash
  bytes INTEGER NOT NULL CHECK (bytes >= 0),
  why   TEXT NOT NULL CHECK (length(why) > 0)
) STRICT;
INSERT INTO removal VALUES(1,1728000127000,'log','ffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffff',10,'too old');
CREATE TABLE replay (
  id           INTEGER PRIMARY KEY,
  evaluation   INTEGER NOT NULL,
  idx          INTEGER NOT NULL,
  attempt      INTEGER NOT NULL,
  differs_json TEXT NOT NULL,            -- names of what differs
  facts_json   TEXT NOT NULL,            -- of the later playing; the row in episode counts
  recorded_at  INTEGER NOT NULL,
  UNIQUE (evaluation, idx, attempt),
  FOREIGN KEY (evaluation, idx) REFERENCES episode (evaluation, idx)
) STRICT;
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
INSERT INTO request_key VALUES('uid 1001','a-key','af0bf2a562dabe2a81e0b0b47a33a515b5e8495c72fff218af4c15f3f066fa44',1,1,1,1728004680000);
CREATE TABLE seed_list (
  hash       TEXT PRIMARY KEY CHECK (length(hash) = 64),
  count      INTEGER NOT NULL CHECK (count > 0),
  seeds_json TEXT NOT NULL
) STRICT;
INSERT INTO seed_list VALUES('b3785f633e465cfbdb46548dc6f98afded356dd543ba409e0113b9180997a97d',6,'[0,10,20,30,40,50]');
INSERT INTO seed_list VALUES('5708d219550e515e957055b3054db27138a591e594d0ee4c957f7ccd77fd066f',6,'[1,11,21,31,41,51]');
INSERT INTO seed_list VALUES('1f84f74f0f79c1fc5db7703ef10cbfb724bcd6eb20aecd7a1660b8f9dbcafbec',4,'[2,12,22,32]');
INSERT INTO seed_list VALUES('95871c2b0a5ed9f0e8b32014eb8d5663b14a34a5f66b2373aca23fcf92c0745c',4,'[3,13,23,33]');
INSERT INTO seed_list VALUES('3b28906b81b312ae2266c2b081413232bc0083e4f4e3d737b83fb7ad19c86f04',2,'[4,14]');
CREATE TABLE standing (
  evaluation     INTEGER PRIMARY KEY REFERENCES evaluation (id),
  successes      INTEGER NOT NULL,
  episodes       INTEGER NOT NULL,
  names          TEXT NOT NULL,  -- of the numbers that boards rank by, joined with commas
  numbers        BLOB NOT NULL,  -- a double each, least significant byte first; NaN is none
  aggregate_json TEXT NOT NULL   -- holds the numbers above too
) STRICT;
INSERT INTO standing VALUES(1,6,6,'time_s,effort',X'000000000000f03f0000000000000000','{"distance_m":null,"effort":0.0,"effort_over_steps":0.0,"effort_sum":0.0,"episodes":6,"max_touch_n":0.0,"pain":null,"pain_over_steps":null,"pain_sum":null,"peak_force_n":0.0,"reported_time_s":0.0,"spread":{"distance_m":null,"effort":{"deviation":0.0,"high":0.0,"low":0.0},"pain":null,"success_rate":{"deviation":0.0,"high":1.0,"low":0.6096657120978346},"time_s":{"deviation":0.0,"high":1.0,"low":1.0}},"success_rate":1.0,"successes":6,"time_s":1.0}');
INSERT INTO standing VALUES(2,0,6,'time_s,effort',X'00000000000024400000000000000000','{"distance_m":null,"effort":0.0,"effort_over_steps":0.0,"effort_sum":0.0,"episodes":6,"max_touch_n":0.0,"pain":null,"pain_over_steps":null,"pain_sum":null,"peak_force_n":0.0,"reported_time_s":0.0,"spread":{"distance_m":null,"effort":{"deviation":0.0,"high":0.0,"low":0.0},"pain":null,"success_rate":{"deviation":0.0,"high":0.39033428790216534,"low":0.0},"time_s":{"deviation":0.0,"high":10.0,"low":10.0}},"success_rate":0.0,"successes":0,"time_s":10.0}');
CREATE TABLE submission (
  id          INTEGER PRIMARY KEY AUTOINCREMENT,
  team_id     INTEGER NOT NULL REFERENCES team (id),
  artefact    TEXT NOT NULL REFERENCES artefact (hash),
  track       TEXT NOT NULL,
  profile     TEXT NOT NULL,
  config      TEXT NOT NULL REFERENCES config (hash),
  seeds       TEXT NOT NULL REFERENCES seed_list (hash),
  ranked      INTEGER NOT NULL CHECK (ranked IN (0, 1)),  -- plays exactly the config's seeds
  accepted_by TEXT NOT NULL,
  accepted_at INTEGER NOT NULL
, phase TEXT NOT NULL DEFAULT '', extra_observations INTEGER NOT NULL DEFAULT 0
  CHECK (extra_observations IN (0, 1))) STRICT;
INSERT INTO submission VALUES(1,1,'c7c2e19b891b7062dc266f6b92e81978d7daa3960a35a0fef0e653248a0460b3','demo-manipulation','paper','fa0d77852c176878aaf0ebd88394e40b8e1ae9283c1e6444372c4c0f82f802e8','b3785f633e465cfbdb46548dc6f98afded356dd543ba409e0113b9180997a97d',1,'uid 1001',1728000000000,'',0);
INSERT INTO submission VALUES(2,2,'81c55187a1ef6c8f83e01d3a49e5faf0675394de0239f210adfdfd14aea05e08','demo-manipulation','paper','fa0d77852c176878aaf0ebd88394e40b8e1ae9283c1e6444372c4c0f82f802e8','5708d219550e515e957055b3054db27138a591e594d0ee4c957f7ccd77fd066f',1,'uid 1003',1728000060000,'',0);
INSERT INTO submission VALUES(3,1,'239ab30d804924fd096504e1017e24d1e7dca9eac51e3a8aa7d8b776f820008f','demo-manipulation','paper','fa0d77852c176878aaf0ebd88394e40b8e1ae9283c1e6444372c4c0f82f802e8','1f84f74f0f79c1fc5db7703ef10cbfb724bcd6eb20aecd7a1660b8f9dbcafbec',1,'uid 1002',1728000120000,'',0);
INSERT INTO submission VALUES(4,2,'cabcc58cc0c74efa757f5db42d26ddd9df22c152c298c361203648424c8056e2','demo-manipulation','paper','fa0d77852c176878aaf0ebd88394e40b8e1ae9283c1e6444372c4c0f82f802e8','95871c2b0a5ed9f0e8b32014eb8d5663b14a34a5f66b2373aca23fcf92c0745c',1,'uid 1003',1728000120000,'',1);
INSERT INTO submission VALUES(5,2,'86054eaf46ab6b5994904e312a9abade429d9e82e6cfe2686945d20c366d5dad','demo-manipulation','paper','fa0d77852c176878aaf0ebd88394e40b8e1ae9283c1e6444372c4c0f82f802e8','3b28906b81b312ae2266c2b081413232bc0083e4f4e3d737b83fb7ad19c86f04',1,'test',1728000120000,'',0);
CREATE TABLE team (
  id         INTEGER PRIMARY KEY,
  name       TEXT NOT NULL UNIQUE CHECK (length(name) > 0),
  created_at INTEGER NOT NULL
, merged_into INTEGER REFERENCES team (id), banned INTEGER NOT NULL DEFAULT 0 CHECK (banned IN (0, 1))) STRICT;
INSERT INTO team VALUES(1,'victim',1728000000000,NULL,0);
INSERT INTO team VALUES(2,'other',1728000060000,NULL,0);
INSERT INTO team VALUES(3,'last',1728003780000,NULL,0);
INSERT INTO team VALUES(4,'fourth',1728003900000,NULL,1);
INSERT INTO team VALUES(5,'fifth',1728004020000,3,0);
CREATE TABLE team_event (
  id      INTEGER PRIMARY KEY AUTOINCREMENT,
  at      INTEGER NOT NULL,
  team_id INTEGER NOT NULL REFERENCES team (id),
  event   TEXT NOT NULL CHECK (event IN ('created', 'renamed', 'merged', 'banned', 'unbanned')),
  detail  TEXT NOT NULL,                 -- the former name, or the team it was merged into; else ''
  who     TEXT NOT NULL CHECK (length(who) > 0),
  why     TEXT NOT NULL
) STRICT;
INSERT INTO team_event VALUES(1,1728003780000,3,'created','','uid 0','registered');
INSERT INTO team_event VALUES(2,1728003840000,3,'renamed','third','uid 0','asked for');
INSERT INTO team_event VALUES(3,1728003900000,4,'created','','uid 0','registered');
INSERT INTO team_event VALUES(4,1728003960000,4,'banned','','uid 0','cheated');
INSERT INTO team_event VALUES(5,1728004020000,5,'created','','uid 0','registered');
INSERT INTO team_event VALUES(6,1728004080000,5,'merged','last','uid 0','one team');
CREATE TABLE team_look (
  look TEXT NOT NULL,
  team INTEGER NOT NULL REFERENCES team (id),
  PRIMARY KEY (look, team)
) STRICT, WITHOUT ROWID;
INSERT INTO team_look VALUES('victirn',1);
INSERT INTO team_look VALUES('other',2);
INSERT INTO team_look VALUES('last',3);
INSERT INTO team_look VALUES('third',3);
INSERT INTO team_look VALUES('fourth',4);
INSERT INTO team_look VALUES('fifth',5);
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
INSERT INTO token VALUES(1,'11f2e213862175fb08d79ec07da1938b973732f3edb0b7a49068313df36e5a35','participant',2,'laptop',1728004140000,'uid 0',NULL,NULL,NULL,NULL);
INSERT INTO token VALUES(2,'ae7400a78cb3b222cff49babd51d90085bdce57b9bdb809cb6dd67bd403d352d','organiser',NULL,'desk',1728004200000,'uid 0',NULL,1728004260000,'uid 0',NULL);
CREATE TABLE transition (
  id         INTEGER PRIMARY KEY AUTOINCREMENT,
  at         INTEGER NOT NULL,
  entity     TEXT NOT NULL CHECK (entity IN ('submission', 'evaluation', 'lease')),
  entity_id  INTEGER NOT NULL,
  from_state TEXT NOT NULL,              -- '' for what is new
  to_state   TEXT NOT NULL,
  who        TEXT NOT NULL CHECK (length(who) > 0),
  why        TEXT NOT NULL
) STRICT;
INSERT INTO transition VALUES(1,1728000000000,'submission',1,'','accepted','test','');
INSERT INTO transition VALUES(2,1728000000000,'evaluation',1,'','queued','test','');
INSERT INTO transition VALUES(3,1728000000000,'lease',1,'','pending','test','');
INSERT INTO transition VALUES(4,1728000000000,'lease',2,'','pending','test','');
INSERT INTO transition VALUES(5,1728000000000,'lease',3,'','pending','test','');
INSERT INTO transition VALUES(6,1728000000000,'lease',1,'pending','running','daemon 11594','attempt 1 on slot 0');
INSERT INTO transition VALUES(7,1728000000000,'evaluation',1,'queued','running','daemon 11594','its first lease started');
INSERT INTO transition VALUES(8,1728000000000,'lease',2,'pending','running','daemon 11594','attempt 1 on slot 1');
INSERT INTO transition VALUES(9,1728000010000,'lease',1,'running','done','daemon 11594','attempt 1');
INSERT INTO transition VALUES(10,1728000010000,'lease',2,'running','done','daemon 11594','attempt 1');
INSERT INTO transition VALUES(11,1728000010000,'lease',3,'pending','running','daemon 11594','attempt 1 on slot 0');
INSERT INTO transition VALUES(12,1728000020000,'lease',3,'running','done','daemon 11594','attempt 1');
INSERT INTO transition VALUES(13,1728000020000,'evaluation',1,'running','done','daemon 11594','');
INSERT INTO transition VALUES(14,1728000060000,'submission',2,'','accepted','test','');
INSERT INTO transition VALUES(15,1728000060000,'evaluation',2,'','queued','test','');
INSERT INTO transition VALUES(16,1728000060000,'lease',4,'','pending','test','');
INSERT INTO transition VALUES(17,1728000060000,'lease',5,'','pending','test','');
INSERT INTO transition VALUES(18,1728000060000,'lease',6,'','pending','test','');
INSERT INTO transition VALUES(19,1728000060000,'lease',4,'pending','running','daemon 11594','attempt 1 on slot 0');
INSERT INTO transition VALUES(20,1728000060000,'evaluation',2,'queued','running','daemon 11594','its first lease started');
INSERT INTO transition VALUES(21,1728000060000,'lease',5,'pending','running','daemon 11594','attempt 1 on slot 1');
INSERT INTO transition VALUES(22,1728000070000,'lease',4,'running','done','daemon 11594','attempt 1');
INSERT INTO transition VALUES(23,1728000070000,'lease',5,'running','done','daemon 11594','attempt 1');
INSERT INTO transition VALUES(24,1728000070000,'lease',6,'pending','running','daemon 11594','attempt 1 on slot 0');
INSERT INTO transition VALUES(25,1728000080000,'lease',6,'running','done','daemon 11594','attempt 1');
INSERT INTO transition VALUES(26,1728000080000,'evaluation',2,'running','done','daemon 11594','');
INSERT INTO transition VALUES(27,1728000120000,'submission',3,'','accepted','test','');
INSERT INTO transition VALUES(28,1728000120000,'evaluation',3,'','queued','test','');
INSERT INTO transition VALUES(29,1728000120000,'lease',7,'','pending','test','');
INSERT INTO transition VALUES(30,1728000120000,'lease',8,'','pending','test','');
INSERT INTO transition VALUES(31,1728000120000,'lease',7,'pending','running','daemon 11594','attempt 1 on slot 0');
INSERT INTO transition VALUES(32,1728000120000,'evaluation',3,'queued','running','daemon 11594','its first lease started');
INSERT INTO transition VALUES(33,1728000120000,'lease',8,'pending','running','daemon 11594','attempt 1 on slot 1');
INSERT INTO transition VALUES(34,1728000120000,'submission',4,'','accepted','test','');
INSERT INTO transition VALUES(35,1728000120000,'evaluation',4,'','queued','test','');
INSERT INTO transition VALUES(36,1728000120000,'lease',9,'','pending','test','');
INSERT INTO transition VALUES(37,1728000120000,'lease',10,'','pending','test','');
INSERT INTO transition VALUES(38,1728000120000,'submission',5,'','accepted','test','');
INSERT INTO transition VALUES(39,1728000120000,'evaluation',5,'','queued','test','');
INSERT INTO transition VALUES(40,1728000120000,'lease',11,'','pending','test','');
CREATE TABLE upload (
  artefact TEXT PRIMARY KEY REFERENCES artefact (hash),
  uploader TEXT NOT NULL,                -- as 'uid 1000'; '' is not known
  team     TEXT NOT NULL,                -- '' is not known
  at       INTEGER NOT NULL
) STRICT;
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
INSERT INTO lease_run VALUES(1,1,'n1','12_0',1728000009000,1728000010000,900,NULL,'done');
INSERT INTO lease_run VALUES(2,1,'n1','12_0',1728000009000,1728000010000,900,NULL,'done');
CREATE TABLE node_event (
  id    INTEGER PRIMARY KEY AUTOINCREMENT,
  at    INTEGER NOT NULL,
  node  TEXT NOT NULL CHECK (length(node) > 0),
  event TEXT NOT NULL CHECK (event IN ('drained', 'admitted')),
  who   TEXT NOT NULL CHECK (length(who) > 0),
  why   TEXT NOT NULL
) STRICT;
INSERT INTO node_event VALUES(1,1728004620000,'n2','drained','uid 0','a fault');
DELETE FROM sqlite_sequence;
INSERT INTO sqlite_sequence VALUES('submission',5);
INSERT INTO sqlite_sequence VALUES('evaluation',5);
INSERT INTO sqlite_sequence VALUES('lease',11);
INSERT INTO sqlite_sequence VALUES('transition',40);
INSERT INTO sqlite_sequence VALUES('ledger',15);
INSERT INTO sqlite_sequence VALUES('mark',1);
INSERT INTO sqlite_sequence VALUES('removal',1);
INSERT INTO sqlite_sequence VALUES('member',5);
INSERT INTO sqlite_sequence VALUES('team_event',6);
INSERT INTO sqlite_sequence VALUES('token',2);
INSERT INTO sqlite_sequence VALUES('phase_event',3);
INSERT INTO sqlite_sequence VALUES('choice',1);
INSERT INTO sqlite_sequence VALUES('access_event',2);
INSERT INTO sqlite_sequence VALUES('node_event',1);
CREATE INDEX submission_by_team ON submission (team_id, id);
CREATE INDEX submission_by_board ON submission (config, ranked, id);
CREATE UNIQUE INDEX evaluation_original ON evaluation (submission) WHERE kind = 'original';
CREATE INDEX evaluation_by_submission ON evaluation (submission, id);
CREATE INDEX evaluation_unfinished ON evaluation (id) WHERE finished_at IS NULL;
CREATE INDEX lease_unfinished ON lease (evaluation) WHERE finished_at IS NULL;
CREATE INDEX transition_by_entity ON transition (entity, entity_id, id);
CREATE INDEX admission_by_team ON admission (team_id, track, budget, day);
CREATE INDEX admission_by_day ON admission (day);
CREATE UNIQUE INDEX ledger_once ON ledger (submission, budget, entry)
  WHERE submission IS NOT NULL;
CREATE INDEX ledger_by_team ON ledger (team_id, track, id);
CREATE INDEX ledger_by_day ON ledger (day);
CREATE INDEX mark_by_submission ON mark (submission, mark, id);
CREATE INDEX submission_by_artefact ON submission (artefact);
CREATE INDEX submission_by_official ON submission (team_id, artefact, config);
CREATE TRIGGER transition_fixed BEFORE UPDATE ON transition
  BEGIN SELECT RAISE(ABORT, 'audit rows are never changed'); END;
CREATE TRIGGER transition_kept BEFORE DELETE ON transition
  BEGIN SELECT RAISE(ABORT, 'audit rows are never deleted'); END;
CREATE TRIGGER episode_fixed
  BEFORE UPDATE OF evaluation, idx, lease, attempt, seed, facts_json ON episode
  BEGIN SELECT RAISE(ABORT, 'the facts of an episode are never changed'); END;
CREATE TRIGGER episode_kept BEFORE DELETE ON episode
  BEGIN SELECT RAISE(ABORT, 'episodes are never deleted'); END;
CREATE TRIGGER episode_in_lease BEFORE INSERT ON episode
  WHEN NOT EXISTS (SELECT 1 FROM lease WHERE id = NEW.lease AND evaluation = NEW.evaluation
                     AND NEW.idx BETWEEN first AND last)
  BEGIN SELECT RAISE(ABORT, 'an episode belongs to a lease of its evaluation that holds it'); END;
CREATE TRIGGER replay_fixed BEFORE UPDATE ON replay
  BEGIN SELECT RAISE(ABORT, 'replay rows are never changed'); END;
CREATE TRIGGER replay_kept BEFORE DELETE ON replay
  BEGIN SELECT RAISE(ABORT, 'replay rows are never deleted'); END;
CREATE TRIGGER config_fixed BEFORE UPDATE ON config
  BEGIN SELECT RAISE(ABORT, 'a config is never changed'); END;
CREATE TRIGGER seed_list_fixed BEFORE UPDATE ON seed_list
  BEGIN SELECT RAISE(ABORT, 'a seed list is never changed'); END;
CREATE TRIGGER lease_final BEFORE UPDATE OF state ON lease
  WHEN OLD.finished_at IS NOT NULL
  BEGIN SELECT RAISE(ABORT, 'a lease that ended stays ended'); END;
CREATE TRIGGER evaluation_final BEFORE UPDATE OF state ON evaluation
  WHEN OLD.finished_at IS NOT NULL
  BEGIN SELECT RAISE(ABORT, 'an evaluation that ended stays ended'); END;
CREATE TRIGGER board_by_new_evaluation AFTER INSERT ON evaluation WHEN NEW.state = 'done'
  BEGIN UPDATE board_state SET changes = changes + 1; END;
CREATE TRIGGER board_by_mark AFTER INSERT ON mark
  BEGIN UPDATE board_state SET changes = changes + 1; END;
CREATE TRIGGER admission_fixed BEFORE UPDATE ON admission
  BEGIN SELECT RAISE(ABORT, 'an admission is never changed'); END;
CREATE TRIGGER admission_kept BEFORE DELETE ON admission
  BEGIN SELECT RAISE(ABORT, 'an admission is never deleted'); END;
CREATE TRIGGER ledger_fixed BEFORE UPDATE ON ledger
  BEGIN SELECT RAISE(ABORT, 'ledger rows are never changed'); END;
CREATE TRIGGER ledger_kept BEFORE DELETE ON ledger
  BEGIN SELECT RAISE(ABORT, 'ledger rows are never deleted'); END;
CREATE TRIGGER ledger_refund BEFORE INSERT ON ledger
  WHEN NEW.entry = 'refund' AND NOT EXISTS
    (SELECT 1 FROM ledger WHERE submission = NEW.submission AND budget = NEW.budget
       AND entry = 'charge' AND amount = NEW.amount AND day = NEW.day)
  BEGIN SELECT RAISE(ABORT, 'a refund gives back one charge, for its day'); END;
CREATE TRIGGER mark_fixed BEFORE UPDATE ON mark
  BEGIN SELECT RAISE(ABORT, 'marks are never changed; a further row takes one back'); END;
CREATE TRIGGER mark_kept BEFORE DELETE ON mark
  BEGIN SELECT RAISE(ABORT, 'marks are never deleted; a further row takes one back'); END;
CREATE TRIGGER removal_fixed BEFORE UPDATE ON removal
  BEGIN SELECT RAISE(ABORT, 'removals are never changed'); END;
CREATE TRIGGER removal_kept BEFORE DELETE ON removal
  BEGIN SELECT RAISE(ABORT, 'removals are never deleted'); END;
CREATE TRIGGER submission_kept BEFORE DELETE ON submission
  BEGIN SELECT RAISE(ABORT, 'submissions are never deleted'); END;
CREATE TRIGGER board_by_evaluation AFTER UPDATE OF state ON evaluation
  WHEN NEW.state = 'done' AND NEW.kind = 'original' AND
       EXISTS (SELECT 1 FROM submission WHERE id = NEW.submission AND ranked = 1)
  BEGIN UPDATE board_state SET changes = changes + 1; END;
CREATE INDEX episode_by_log ON episode (
  CASE WHEN typeof(facts_json) = 'text' AND json_valid(facts_json)
  THEN ifnull(json_extract(facts_json, '$.log.sha256'), '') END);
CREATE INDEX team_look_by_team ON team_look (team);
CREATE INDEX upload_by_uploader ON upload (uploader);
CREATE INDEX upload_by_team ON upload (team);
CREATE TRIGGER board_by_dropping AFTER DELETE ON standing
  BEGIN UPDATE board_state SET changes = changes + 1; END;
CREATE INDEX team_event_by_team ON team_event (team_id, id);
CREATE INDEX member_by_team ON member (team_id, person, id);
CREATE INDEX member_by_person ON member (person, team_id, id);
CREATE INDEX phase_event_by_phase ON phase_event (phase, id);
CREATE INDEX choice_by_team ON choice (phase, team_id, id);
CREATE INDEX request_key_by_age ON request_key (at);
CREATE INDEX request_key_by_caller ON request_key (who, at DESC, key);
CREATE INDEX submission_by_phase ON submission (phase, id) WHERE phase != '';
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
CREATE INDEX rejudge_item_by_submission ON rejudge_item (submission, rejudge);
CREATE INDEX rejudge_event_by_rejudge ON rejudge_event (rejudge, id);
CREATE INDEX board_config_by_board ON board_config (phase, track, profile, id);
CREATE INDEX record_by_evaluation ON record (evaluation, id) WHERE evaluation IS NOT NULL;
CREATE INDEX delivery_waiting ON delivery (webhook, id) WHERE state = 'waiting';
CREATE INDEX evaluation_by_state ON evaluation (kind, state);
CREATE TRIGGER board_by_standing AFTER INSERT ON standing
  WHEN EXISTS (SELECT 1 FROM evaluation AS e JOIN submission AS s ON s.id = e.submission
                 WHERE e.id = NEW.evaluation AND e.kind IN ('original', 'rejudge') AND s.ranked = 1)
  BEGIN UPDATE board_state SET changes = changes + 1; END;
CREATE TRIGGER board_by_failed_rejudge AFTER UPDATE OF state ON evaluation
  WHEN NEW.kind = 'rejudge' AND NEW.state = 'failed'
  BEGIN UPDATE board_state SET changes = changes + 1; END;
CREATE TRIGGER board_by_rejudge AFTER INSERT ON rejudge_event
  BEGIN UPDATE board_state SET changes = changes + 1; END;
CREATE TRIGGER board_by_config AFTER INSERT ON board_config
  BEGIN UPDATE board_state SET changes = changes + 1; END;
CREATE TRIGGER rejudge_fixed BEFORE UPDATE ON rejudge
  BEGIN SELECT RAISE(ABORT, 'a rejudge is never changed'); END;
CREATE TRIGGER rejudge_kept BEFORE DELETE ON rejudge
  BEGIN SELECT RAISE(ABORT, 'a rejudge is never deleted'); END;
CREATE TRIGGER rejudge_item_fixed BEFORE UPDATE ON rejudge_item
  BEGIN SELECT RAISE(ABORT, 'what a rejudge holds is never changed'); END;
CREATE TRIGGER rejudge_item_kept BEFORE DELETE ON rejudge_item
  BEGIN SELECT RAISE(ABORT, 'what a rejudge holds is never deleted'); END;
CREATE TRIGGER rejudge_event_fixed BEFORE UPDATE ON rejudge_event
  BEGIN SELECT RAISE(ABORT, 'what became of a rejudge is never changed'); END;
CREATE TRIGGER rejudge_event_kept BEFORE DELETE ON rejudge_event
  BEGIN SELECT RAISE(ABORT, 'what became of a rejudge is never deleted'); END;
CREATE TRIGGER board_config_fixed BEFORE UPDATE ON board_config
  BEGIN SELECT RAISE(ABORT, 'the configs that boards had are never changed'); END;
CREATE TRIGGER board_config_kept BEFORE DELETE ON board_config
  BEGIN SELECT RAISE(ABORT, 'the configs that boards had are never deleted'); END;
CREATE TRIGGER record_in_order BEFORE INSERT ON record
  WHEN NEW.id != (SELECT ifnull(max(id) + 1, 0) FROM record)
  BEGIN SELECT RAISE(ABORT, 'the record''s ids are 0, 1, 2 and so on'); END;
CREATE TRIGGER record_fixed BEFORE UPDATE ON record
  BEGIN SELECT RAISE(ABORT, 'the record is never changed'); END;
CREATE TRIGGER record_kept BEFORE DELETE ON record
  BEGIN SELECT RAISE(ABORT, 'the record is never deleted'); END;
CREATE TRIGGER artefact_fixed BEFORE UPDATE ON artefact
  BEGIN SELECT RAISE(ABORT, 'an artefact is never changed'); END;
CREATE TRIGGER episode_details_fixed BEFORE UPDATE ON episode_details
  BEGIN SELECT RAISE(ABORT, 'the details of an episode are never changed'); END;
CREATE TRIGGER episode_details_kept BEFORE DELETE ON episode_details
  BEGIN SELECT RAISE(ABORT, 'the details of an episode are never deleted'); END;
CREATE INDEX node_event_by_node ON node_event (node, id);
CREATE TRIGGER lease_run_fixed BEFORE UPDATE ON lease_run
  BEGIN SELECT RAISE(ABORT, 'what an attempt used is never changed'); END;
CREATE TRIGGER lease_run_kept BEFORE DELETE ON lease_run
  BEGIN SELECT RAISE(ABORT, 'what an attempt used is never deleted'); END;
CREATE TRIGGER node_event_fixed BEFORE UPDATE ON node_event
  BEGIN SELECT RAISE(ABORT, 'what was done to a node is never changed'); END;
CREATE TRIGGER node_event_kept BEFORE DELETE ON node_event
  BEGIN SELECT RAISE(ABORT, 'what was done to a node is never deleted'); END;
COMMIT;
PRAGMA user_version = 10;
