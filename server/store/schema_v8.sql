-- Version 8 of the store.
--
--   artefact.manifest_json   what a manifest holds beyond its name, command, runtimes and variables:
--                            an object, empty for artefacts of earlier versions. "image": how the
--                            program of a container image is started (protocol/lease/policy_image.h)
ALTER TABLE artefact ADD COLUMN manifest_json TEXT NOT NULL DEFAULT '{}';
