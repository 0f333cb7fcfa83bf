# Two commands from a fresh clone: `make demo` and `make test`. Each sets up what it needs.

PYTHON ?= python3
BIN := .venv/bin

# 1,000,000 frames in 10 runs, beside the seeds of the tests.
FUZZ_SEEDS := 100 101 102 103 104 105 106 107 108 109
FIRMWARE := $(MAKE) --no-print-directory -s -C jammkle_driver/firmware

.PHONY: help extras demo test slow bench live blind robots contact benefit paper studies exercises faults soak firmware docs pictures lint format readme lock wheels try-wheels release set-up clean

help:
	@echo "make demo   set up, land a simulated ankle on a slope, record it, diagnose what is wrong with it"
	@echo "make extras set up, with all that the demo does not need: plot, export, Foxglove, studies, tests, lint"
	@echo "make test   set up, run the tests"
	@echo "make slow   set up, run the slow tests: whole trials, soaks, every example of the pages"
	@echo "make bench  set up, measure speed; writes bench.json"
	@echo "make live   set up, ten minutes of landings at 1 kHz through the live graph, and four ankles; writes live.json"
	@echo "make faults set up, on two laws of the air, inject 500 random faults and jam for an hour; writes studies/faults/README.md, 30 minutes"
	@echo "make soak   set up, 20 demos, ten times the graph tests and once all tests beside four busy loops; jam half an hour with random faults, once simulated and once on the firmware; 1,000,000 malformed frames; malformed requests, 100,000 and 17,000 over DDS"
	@echo "make blind  set up, check the diagnosis of an ankle blind: 100 machines in other equations; goes on where it was stopped"
	@echo "make robots set up, check the diagnosis of any robot blind: 100 cases, some hours; goes on where it was stopped"
	@echo "make paper  set up, run every test of the paper; writes runs/paper/paper.html, half a minute"
	@echo "make studies set up, run the tests of the studies"
	@echo "make contact set up, try the detectors on 4000 steps, slips and landings; writes runs/contact, 20 minutes"
	@echo "make benefit set up, land, push and walk robots in every way that is compared; writes runs/benefit, some hours"
	@echo "make exercises set up, say what an ideal observer sees in each exercise; writes studies/exercises/README.md, 10 minutes"
	@echo "make firmware set up, build the board's firmware, and test it in simavr where the tools for AVR are installed"
	@echo "make docs   build the documentation as pages: docs/_build/index.html"
	@echo "make pictures set up, draw the landing of README anew, and take the pictures of the page, where there is Chromium"
	@echo "make lint   set up, ruff and mypy"
	@echo "make format set up, format the code with ruff"
	@echo "make readme set up, write anew what is made from the code: tables of the documents, the firmware's registers"
	@echo "make lock   pin what requirements.in and docs/requirements.in name anew"
	@echo "make wheels build the wheels of this version into dist; make try-wheels uses them in clean environments"
	@echo "make release VERSION=1.2.3  write version and changelog, commit, tag, build the wheels"
	@echo "make clean  remove everything that the other targets made"

set-up:
	@$(PYTHON) jammkle_bringup/scripts/set_up.py

extras: set-up
	@$(PYTHON) jammkle_bringup/scripts/set_up.py --extras

demo: set-up
	@$(BIN)/jammkle demo

test: extras
	@$(BIN)/python -m pytest -n 3 --dist loadfile --no-loadscope-reorder  # graphs wait; a file shares fixtures

slow: extras
	@$(BIN)/python -m pytest -n 3 -m slow --deselect test/test_several_boards.py
	@$(BIN)/python -m pytest -m slow test/test_several_boards.py  # boards live by the steady clock

studies: extras .venv/other_robots
	@$(BIN)/python -m pytest studies -n auto --maxprocesses 4 -m "slow or not slow"

paper: extras
	@$(BIN)/python -m studies.paper -o runs/paper --json runs/paper/paper.json

bench: extras
	@PYTHONPATH=test $(BIN)/python test/bench/run.py --json bench.json

live: extras
	@PYTHONPATH=test $(BIN)/python test/bench/live.py --json live.json

faults: extras
	@PYTHONPATH=test $(BIN)/python -m studies.faults --seed 4000 --hours 0.5 --page studies/faults/README.md

soak: extras
	@PYTHONPATH=test $(BIN)/python -m studies.faults.busy --suite
	@PYTHONPATH=test $(BIN)/python -m studies.faults.soak
	@PYTHONPATH=test $(BIN)/python -m studies.faults.board_soak
	@$(FIRMWARE) fuzz
	@for seed in $(FUZZ_SEEDS); do jammkle_driver/firmware/build/fuzz 100000 $$seed || exit 1; done
	@$(BIN)/python -m pytest -q --hypothesis-profile soak \
		jammkle_driver/test/test_driver_requests_fuzz.py jammkle_driver/test/test_driver_requests_on_graph.py

blind: extras
	@$(BIN)/python -m studies.blind

robots: extras
	@$(BIN)/python -m studies.any_robot

contact: extras
	@$(BIN)/python -m studies.contact --steps 4000 --runs 20 -o runs/contact $(addprefix --real ,$(wildcard ../shared/data/foot_imu))

benefit: extras .venv/other_robots
	@for what in landings pushes walks; do $(BIN)/python -m studies.contact.benefit $$what --jobs 2 || exit 1; done

.venv/other_robots: studies/contact/requirements.txt | extras
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --require-hashes --upgrade --target $@ -r $<
	@touch $@

exercises: extras
	@$(BIN)/python -m studies.exercises --page studies/exercises/README.md

firmware: extras
	@$(FIRMWARE) host
	@missing="$$($(FIRMWARE) missing)"; if [ -n "$$missing" ]; then \
		echo "firmware: built for this machine only; for the board install $$missing"; \
	else \
		$(FIRMWARE) avr simavr && JAMMKLE_BOARD=avr $(BIN)/python -m pytest test/test_board_*.py; \
	fi

lint: extras
	@$(BIN)/ruff check
	@$(BIN)/ruff format --check
	@$(BIN)/mypy

docs: .venv-docs/made
	@.venv-docs/bin/sphinx-build --quiet --fail-on-warning --keep-going --jobs auto docs docs/_build
	@echo "docs/_build/index.html"

.venv-docs/made: docs/requirements.lock
	@$(PYTHON) -m venv --clear .venv-docs
	@.venv-docs/bin/python -m pip install --quiet --disable-pip-version-check --no-deps --require-hashes \
		-r docs/requirements.lock
	@touch $@

readme: extras
	@$(BIN)/python test/readme_tables.py

pictures: extras
	@$(BIN)/python -m studies.contact.picture docs/images/landings.png
	@$(BIN)/python test/view_pictures.py

format: extras
	@$(BIN)/ruff check --fix
	@$(BIN)/ruff format

lock: set-up
	@$(BIN)/python -m pip install --quiet uv
	@$(BIN)/uv pip compile --quiet --universal --python-version 3.10 --generate-hashes --no-header \
		requirements.in --output-file requirements.lock
	@sed '/^# \[bags\]/,$$d' requirements.in | $(BIN)/uv pip compile --quiet --universal --python-version 3.10 \
		--generate-hashes --no-header --no-annotate --constraint requirements.lock - --output-file requirements-demo.lock
	@$(BIN)/uv pip compile --quiet --universal --python-version 3.10 --generate-hashes --no-header \
		docs/requirements.in --output-file docs/requirements.lock

wheels: set-up
	@$(BIN)/python jammkle_bringup/scripts/wheels.py

try-wheels: wheels
	@PYTHON=$(PYTHON) bash test/try_wheels.sh

release: set-up
	@$(BIN)/python jammkle_bringup/scripts/release.py $(VERSION)
	@$(MAKE) --no-print-directory wheels

clean:
	@rm -rf .venv .venv-docs docs/_build dist runs bench.json live.json jammkle_driver/firmware/build .mypy_cache .ruff_cache .pytest_cache .hypothesis
	@find . -name __pycache__ -type d -prune -exec rm -rf {} +
