# make demo      plans a real scene and writes its preview
# make test      lint, types and tests
# make bench     the benchmarks and their charts, with other programs to compare with
# make pictures  the pictures of README and docs; needs a Chromium
PYTHON ?= python3
VENV := .venv
RUN := $(VENV)/bin
READY := $(VENV)/.ready

.PHONY: demo test lint bench pictures clean

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
	-$(RUN)/python -m pip install --quiet --disable-pip-version-check -e '.[peers]'
	$(RUN)/python -m benchmarks all
	$(RUN)/python -m benchmarks charts --full

$(READY): pyproject.toml
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "drapeplan needs Python 3.11 or newer: make PYTHON=python3.12 ...")'
	$(PYTHON) -m venv $(VENV)
	$(RUN)/python -m pip install --quiet --disable-pip-version-check -e '.[dev]'
	touch $(READY)

clean:
	rm -rf build dist
