# make demo      plans a real scene and writes its preview
# make test      lint, types and tests
# make bench     all charts, and the figures of the README but those of the studies: 40 min
# make studies   rankings, tuning, robustness, paths, identification: hours; each scene is
#                kept as it is done, and `python -m benchmarks tune SCENE` does one alone
# make pictures  the pictures of README and docs; needs a Chromium
PYTHON ?= python3
VENV := .venv
RUN := $(VENV)/bin
READY := $(VENV)/.ready
PEERS := $(RUN)/python -c 'import tomllib as t; print(*t.load(open("pyproject.toml", "rb"))["project"]["optional-dependencies"]["peers"], sep="\n")'

.PHONY: demo test lint bench studies pictures clean

demo: $(READY)
	$(RUN)/drapeplan plan examples/panel.yaml -o build/plan.json --figure build/first-touch.png
	$(RUN)/drapeplan check build/plan.json
	$(RUN)/drapeplan preview build/plan.json -o build/preview.html
	@echo "Open build/preview.html in a browser."

test: lint
	$(RUN)/python -m pytest -n 2 --dist loadgroup

lint: $(READY)
	$(RUN)/ruff check .
	$(RUN)/ruff format --check .
	$(RUN)/mypy

pictures: $(READY)
	$(RUN)/drapeplan plan examples/panel.yaml -o build/plan.json --figure docs/first-touch.png
	$(RUN)/python docs/pictures.py

bench: $(READY)
	@mkdir -p build
	@$(PEERS) | while read peer; do \
	    $(RUN)/python -m pip install --quiet --disable-pip-version-check "$$peer" \
	        || echo "not installed, so not in the charts: $$peer"; done
	-$(RUN)/python -m benchmarks all
	$(RUN)/python -m benchmarks charts --full
	$(RUN)/python -m benchmarks.charts.needs > build/needs.md && mv build/needs.md docs

studies: $(READY)
	@mkdir -p build
	-$(RUN)/python -m benchmarks studies
	$(RUN)/python -m benchmarks._choosing > build/choosing.md && mv build/choosing.md docs

$(READY): pyproject.toml
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "drapeplan needs Python 3.11 or newer: make PYTHON=python3.12 ...")'
	$(PYTHON) -m venv $(VENV)
	$(RUN)/python -m pip install --quiet --disable-pip-version-check -e '.[dev]'
	touch $(READY)

clean:
	rm -rf build dist
