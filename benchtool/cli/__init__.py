"""The command line: one file per command, none of them with a heavy import at its top."""
