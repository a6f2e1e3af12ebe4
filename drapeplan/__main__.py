"""`python -m drapeplan` is the command line."""

from drapeplan.cli import main

main()
