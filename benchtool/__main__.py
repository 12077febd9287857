"""Run the command line as ``python -m benchtool``."""

from benchtool.commands.app import main

if __name__ == "__main__":
    main()
