"""Fixtures of all tests: where the shared data are, when they are there."""

from __future__ import annotations

from pathlib import Path

import pytest

SHARED = Path(__file__).resolve().parents[2] / "shared"


def _folder(*parts: str) -> Path:
    path = SHARED.joinpath(*parts)
    if not path.is_dir():
        pytest.skip(f"no {'/'.join(parts) or 'shared'} beside the checkout: the shared data are not here")
    return path


@pytest.fixture(scope="session")
def shared() -> Path:
    """Folder of what the work rests on, beside the checkout."""
    return _folder()


@pytest.fixture(scope="session")
def demo() -> Path:
    """Three simulated raw runs with truth."""
    return _folder("data", "demo")


@pytest.fixture(scope="session")
def real() -> Path:
    """Real recorded data."""
    return _folder("data", "real")


# What `make test` leaves to `make test-slow`, to stay below a quarter of an hour on two cores: whole runs navigated again in
# another way, surveys of which a quicker test runs a like one, long statistics. Run both before a release.
SLOW = (
    "tests/test_wheel.py::test_demo_runs_from_the_installed_wheel",
    "tests/test_survey.py::test_raw_run_and_listing_meet_in_one_survey",
    "tests/test_survey.py::test_pipe_book_tells_a_raw_run_how_long_its_joints_are",
    "tests/test_survey.py::test_survey_of_one_run_gives_its_inventory_and_no_comparison",
    "tests/test_survey.py::test_truncated_input_stops_with_the_file_named_and_keeps_what_was_complete",
    "tests/nav/test_bad_input.py",
    "tests/nav/test_coarse_azimuth.py::test_line_of_a_coarse_unit_lies_within_its_sigma_and_no_good_point_is_dropped",
    "tests/nav/test_real_drive.py",
    "tests/nav/test_navigate.py::test_demo_runs_lie_within_three_decimetres[demo-2021]",
    "tests/nav/test_navigate.py::test_demo_runs_lie_within_three_decimetres[demo-2023]",
    "tests/nav/test_navigate.py::test_sigmas_of_the_demo_runs_are_honest",
    "tests/nav/test_navigate.py::test_a_marker_twenty_metres_off_is_found_named_and_does_no_harm",
    "tests/nav/test_navigate.py::test_launch_wrong_by_kilometres_is_not_believed",
    "tests/nav/test_navigate.py::test_a_gap_of_five_seconds_is_bridged",
    "tests/nav/test_navigate.py::test_without_markers_the_sigma_stays_open_and_honest",
    "tests/change/test_change_detection.py",
    "tests/change/test_change_bad_input.py::test_runs_given_out_of_order_are_compared_in_the_order_of_their_dates",
    "tests/synthetic/test_closed_loop.py::test_increments_of_faultless_sensors_return_the_route",
    "tests/synthetic/test_closed_loop.py::test_the_loop_closes_better_at_a_higher_rate_and_without_vibration",
    "tests/synthetic/test_sensors.py::test_dent_is_at_its_clock_and_place_whatever_way_the_tool_runs",
    "tests/caliper/test_real_dent.py",
    "tests/caliper/test_simulated_caliper.py",
    "tests/report/test_page_in_browser.py",
    "tests/report/test_screening.py",
    "tests/report/test_write_report.py::test_an_absent_or_broken_table_is_named_on_the_page",
    "tests/report/test_write_report.py::test_the_printed_report_is_complete",
    "tests/report/test_write_report.py::test_thousands_of_dents_are_listed_and_a_few_are_drawn",
)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the slow tests; put the long survey first, beside what needs no kernels, so that these are compiled once."""
    for item in items:
        if item.nodeid.startswith(SLOW):
            item.add_marker(pytest.mark.slow)
    order = ("tests/test_survey.py", "tests/test_wheel.py", "tests/report", "tests/mesh", "tests/readers", "tests/run")
    items.sort(key=lambda item: next((i for i, name in enumerate(order) if item.nodeid.startswith(name)), len(order)))
