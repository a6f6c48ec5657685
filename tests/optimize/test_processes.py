"""Worker processes: separate from this one, kept for reuse, ended, and replaced after a death."""

import os
import signal
import time

import pytest
from loky.process_executor import BrokenProcessPool

from nlpgrasp.optimize.processes import Processes, cores, separate_processes


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:Trying to resize an executor")  # by tests before it in this process
def test_tasks_run_in_other_processes_that_are_kept():
    processes = Processes(1)
    first = processes.submit(os.getpid).result()
    assert first != os.getpid()
    assert processes.submit(pow, 2, 10).result() == 1024
    assert Processes(1).submit(os.getpid).result() == first


def test_what_a_task_raises_is_raised_by_its_result():
    with pytest.raises(ZeroDivisionError):
        Processes(1).submit(divmod, 1, 0).result()


def test_a_worker_leaves_ctrl_c_to_its_parent():
    assert Processes(1).submit(signal.getsignal, signal.SIGINT).result() == signal.SIG_IGN


def test_a_worker_that_dies_breaks_its_pool_alone():
    with pytest.raises(BrokenProcessPool, match="SIGKILL"):
        Processes(1).submit(signal.raise_signal, signal.SIGKILL).result()
    assert Processes(1).submit(abs, -1).result() == 1


def test_ended_workers_are_gone():
    processes = Processes(1)
    worker = processes.submit(os.getpid).result()
    processes.end()
    with pytest.raises(ProcessLookupError):
        os.kill(worker, 0)


@pytest.mark.slow
def test_separate_processes_are_not_shared_and_are_kept_for_the_next_context():
    with separate_processes(1, 30.0) as outer:
        first = outer.submit(os.getpid).result()
        running = outer.submit(time.sleep, 0.2)
        with separate_processes(1, 30.0) as inner:
            assert inner.submit(os.getpid).result() != first
        assert Processes(1).submit(os.getpid).result() != first
        assert running.result() is None
    with separate_processes(1, 30.0) as later:
        assert later.submit(os.getpid).result() == first


@pytest.mark.slow
def test_separate_processes_end_with_an_error():
    workers = []

    def interrupted():
        with separate_processes(1, 30.0) as processes:
            workers.append(processes.submit(os.getpid).result())
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    with pytest.raises(ProcessLookupError):
        os.kill(workers[0], 0)


@pytest.mark.slow
def test_the_death_of_a_worker_is_noticed_after_idle_workers_ended():
    def twice():
        with separate_processes(1, idle=0.2) as processes:
            first = processes.submit(os.getpid).result(30)
            while os.path.exists(f"/proc/{first}/fd/0"):  # until it has ended for want of work
                time.sleep(0.05)
            processes.submit(_end_soon).result(30)

    with pytest.raises(BrokenProcessPool):
        twice()


def test_cores_are_those_of_this_process():
    assert 1 <= cores() <= (os.cpu_count() or 1)


def _end_soon():
    time.sleep(0.3)
    os.kill(os.getpid(), signal.SIGKILL)
