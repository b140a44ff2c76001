"""Files for other programs: tables, solids, cam profiles, glTF, 3MF."""
