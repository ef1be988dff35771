"""From a YAML file to a checked `SweepConfig`, with errors that name the line and the key.

``values.py`` has the forms of a value, ``points.py`` the table of points, ``groups.py`` the groups
of keys, ``rig.py`` that of a rig, ``sweep.py`` all of them, ``checks.py`` the checks of one part
beside another. ``loading.py`` has the YAML, ``messages.py`` the errors and what people type instead
of a key, ``json_schema.py`` the schema for editors, ``scenes.py`` the scenes that come with the
program.
"""
