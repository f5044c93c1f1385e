"""A large store in seconds: submissions of a small one, copied with all that belongs to them."""

import hashlib
import json


def copy_rows(database, table, where, changes):
    """Inserts the rows of `where` again, columns replaced by SQL expressions."""
    names = [row[1] for row in database.execute(f"PRAGMA table_info({table})")]
    values = ", ".join(changes.get(name, name) for name in names)
    database.execute(
        f"INSERT INTO {table} ({', '.join(names)}) SELECT {values} FROM {table} WHERE {where}")


def copy_act(database, where, changes, evaluation=None):
    """Adds an act like the one of `where` at the end of the journal and of the public record."""
    at, kind, who, private, text = database.execute(
        f"SELECT at, kind, who, private_json, entry_json FROM journal WHERE {where}").fetchone()
    entry, chain = database.execute(
        "SELECT entry, chain FROM journal ORDER BY entry DESC LIMIT 1").fetchone()
    text = json.dumps({**json.loads(text), **changes}, sort_keys=True, separators=(",", ":"),
                      ensure_ascii=False)
    chain = hashlib.sha256(f"{chain}\n{text}".encode()).hexdigest()
    database.execute("INSERT INTO journal (at, kind, who, evaluation, private_json, entry, entry_json,"
                     " chain) VALUES (?, ?, ?, ?, ?, ?, ?, ?)",
                     (at, kind, who, evaluation, private, entry + 1, text, chain))


def copy_submission(database, source, number, team):
    """Makes submission and evaluation `number` of the team with the id `team`, which is made if there
    is none, graded as submission and evaluation `source` are."""
    artefact, name = f"{number:064x}", f"Team {team}"
    of_source = f"(SELECT team_id FROM submission WHERE id = {source})"
    if database.execute("SELECT 1 FROM team WHERE id = ?", (team,)).fetchone() is None:
        copy_rows(database, "team", f"id = {of_source}", {"id": str(team), "name": f"'{name}'"})
        copy_act(database, "kind = 'team' AND json_extract(entry_json, '$.event') = 'created' AND "
                           f"json_extract(entry_json, '$.team_id') = {of_source}",
                 {"team_id": team, "team": name})
    copy_rows(database, "artefact",
              f"hash = (SELECT artefact FROM submission WHERE id = {source})",
              {"hash": f"'{artefact}'"})
    copy_rows(database, "submission", f"id = {source}",
              {"id": str(number), "team_id": str(team), "artefact": f"'{artefact}'"})
    copy_rows(database, "evaluation", f"id = {source}",
              {"id": str(number), "submission": str(number)})
    copy_act(database, "kind = 'accepted' AND "
                       f"json_extract(entry_json, '$.submission') = {source}",
             {"submission": number, "evaluation": number, "team_id": team, "team": name,
              "artefact": hashlib.sha256(
                  f"myograde artefact/{number}/{artefact}".encode()).hexdigest()})
    copy_act(database, f"evaluation = {source}", {"submission": number, "evaluation": number}, number)
    copy_rows(database, "standing", f"evaluation = {source}", {"evaluation": str(number)})
    apart = number * 1_000_000
    copy_rows(database, "block", f"evaluation = {source}",
              {"id": f"id + {apart}", "evaluation": str(number)})
    copy_rows(database, "episode", f"evaluation = {source}",
              {"evaluation": str(number), "block": f"block + {apart}"})
    copy_rows(database, "episode_details", f"evaluation = {source}",
              {"id": "NULL", "evaluation": str(number)})
