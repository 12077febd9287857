"""Run the command line as ``python -m benchtool``."""

from benchtool.cli.app import main

main()
