# Targets: setup, demo, test, bench, figures, lint, format, clean. ARGS="..." is passed on to what
# a target runs: make demo ARGS="--joint all", make test ARGS="-k planning", make bench ARGS="ik".
SHELL := /bin/bash
ARGS ?=

.PHONY: all setup warm demo test bench figures lint format clean

all: setup

setup:
	@scripts/setup.sh

# Kernels are compiled again only where their sources changed. Many containers ask Python to keep no
# bytecode: then every process would compile all sources that it imports, its packages' included,
# which more than doubles the time that a node takes to start.
CORE := $(shell find ft_manip_ros/core -name '*.py')
warm: setup install/kernels.key
install/kernels.key: $(CORE) scripts/warm_up.py | setup
	@. ./env.sh && env -u PYTHONDONTWRITEBYTECODE python3 scripts/warm_up.py && touch $@

demo: warm
	@. ./env.sh && ros2 run ft_manip_ros demo $(ARGS)

# Tests take ROS domains of their own. FT_MANIP_TELEMETRY names a folder with recorded robot data;
# tests that read it are skipped without.
test: warm
	@. ./env.sh && scripts/test.sh $(ARGS)

bench: warm
	@. ./env.sh && python3 -m bench $(ARGS)

figures: warm
	@. ./env.sh && python3 -m bench.figures $(ARGS)

lint: setup
	@. ./env.sh && ruff check . && ruff format --check . && mypy

format: setup
	@. ./env.sh && ruff check --fix . && ruff format .

clean:
	rm -rf .venv build install log out .pytest_cache .mypy_cache .ruff_cache .hypothesis .setup.lock
	find . -name __pycache__ -not -path './.git/*' -prune -exec rm -rf {} +
