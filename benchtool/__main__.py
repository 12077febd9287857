"""Run the command line as ``python -m benchtool``."""

from benchtool.cli.app import main

if __name__ == "__main__":
    main()
