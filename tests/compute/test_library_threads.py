"""Products of matrices on one thread, inside someone else's process."""

import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from stereo_seecolor.compute.library_threads import (
    PRODUCTS,
    one_thread_in_libraries,
    one_thread_in_products,
)


def threads_of_products() -> set[int]:
    return {
        library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"
    }


@pytest.mark.parametrize(("told", "inside"), [(None, {1}), ("2", {2})])
def test_products_take_one_thread_for_a_while_unless_the_environment_says_more(
    monkeypatch: pytest.MonkeyPatch, told: str | None, inside: set[int]
) -> None:
    monkeypatch.delenv(PRODUCTS, raising=False)
    if told:
        monkeypatch.setenv(PRODUCTS, told)
    with threadpool_limits(2, user_api="blas"):
        with one_thread_in_products():
            assert threads_of_products() == inside
        assert threads_of_products() == {2}


def test_the_command_line_called_from_python_leaves_the_number_to_what_it_runs(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delenv(PRODUCTS, raising=False)
    one_thread_in_libraries()  # numpy is imported: a variable now would change nothing
    with threadpool_limits(2, user_api="blas"), one_thread_in_products():
        assert threads_of_products() == {1}
