-- Version 8 of the store: what else a policy.json may say.
--
--   artefact.options_json   its keys beyond name, command, runtimes and env that differ from their
--                           defaults, canonical: artefact_options.h knows them. A further key needs
--                           no further version

ALTER TABLE artefact ADD COLUMN options_json TEXT NOT NULL DEFAULT '{}';
