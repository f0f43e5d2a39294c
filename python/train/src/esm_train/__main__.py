"""`python -m esm_train`, as torchrun starts it."""

from esm_train.cli import main

main()
