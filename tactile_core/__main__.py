"""`python -m tactile_core` is the command `tactile`, where no console script is installed."""

from tactile_core.commands import main

main(prog_name="tactile")
