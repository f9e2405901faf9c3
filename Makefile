# Aliases only; do.py does the work and needs no make.
.PHONY: campaign test fast bench setup
campaign test fast bench setup:
	@python3 do.py $@
