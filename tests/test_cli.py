"""Commands speak in sentences, exit with the right status, and can be read by machines."""

from __future__ import annotations

import json

import pytest
from typer.testing import CliRunner

from deform.cli import app

runner = CliRunner()
COMMANDS = ("demo", "run", "process", "match", "compare", "screen", "report", "export-dents", "simulate", "info")


def test_help_names_every_command_of_the_contract():
    text = runner.invoke(app, ["--help"]).output
    assert all(name in text for name in COMMANDS)


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_explains_itself(command):
    result = runner.invoke(app, [command, "--help"])
    assert result.exit_code == 0
    assert "Usage" in result.output


def test_version_is_shown():
    assert runner.invoke(app, ["--version"]).output.startswith("deform ")


@pytest.mark.parametrize("arguments", [["run"], ["run", "nowhere.toml"], ["unknown"], ["run", "--speed"], ["match", "nowhere"]])
def test_wrong_usage_exits_with_two(arguments):
    assert runner.invoke(app, arguments).exit_code == 2


def test_bad_survey_exits_with_one_and_names_file_field_and_rule(tmp_path):
    survey = tmp_path / "survey.toml"
    survey.write_text('[line]\nname = "x"\n[[runs]]\nraw = "gone"\n')
    result = runner.invoke(app, ["run", str(survey)])
    assert result.exit_code == 1
    assert "survey.toml [[runs]] 1: raw: gone: no such folder" in result.output
    assert "Traceback" not in result.output


def test_fault_is_machine_readable(tmp_path):
    survey = tmp_path / "survey.toml"
    survey.write_text('[line]\nname = "x"\n[[runs]]\nraw = "gone"\n')
    lines = [json.loads(line) for line in runner.invoke(app, ["run", str(survey), "--json"]).output.splitlines()]
    assert lines[-1]["event"] == "error"
    assert lines[-1]["faults"][0]["field"] == "raw"


def test_matching_in_a_folder_without_runs_says_what_to_do_first(tmp_path):
    result = runner.invoke(app, ["match", str(tmp_path)])
    assert result.exit_code == 1
    assert "deform process RAW" in result.output


def test_info_of_a_file_that_no_reader_knows_says_what_was_tried(tmp_path):
    strange = tmp_path / "strange.bin"
    strange.write_bytes(b"\x00\x01\x02")
    result = runner.invoke(app, ["info", str(strange)])
    assert result.exit_code == 1
    assert "raw_folder" in result.output
