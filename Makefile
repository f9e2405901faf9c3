# Aliases only; do.py does the work and needs no make.
.PHONY: campaign test fast bench crash setup
campaign test fast bench crash setup:
	@python3 do.py $@
