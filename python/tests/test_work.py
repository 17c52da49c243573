"""Long work: code that is kept, threads, progress, interruptions."""

import os
import signal
import subprocess
import sys
import textwrap
import threading
import time

import numpy as np
import pytest

import tamis
from conftest import large


def test_code_is_kept(colors):
    given, expected = colors
    denoiser = tamis.Denoiser()
    assert denoiser.report is None and denoiser.filter.name == "tamis"
    assert np.array_equal(denoiser.denoise(**given), expected)
    assert denoiser.report["compilation_seconds"] > 0
    assert np.array_equal(denoiser.denoise(**given), expected)
    assert denoiser.report["compilation_seconds"] == 0 == denoiser.report["planning_seconds"]
    assert denoiser.report["kept_pixels"] >= 0 and denoiser.report["backend"] == denoiser.backend


def test_threads_do_not_matter(colors):
    given, expected = colors
    assert np.array_equal(tamis.denoise(**given, threads=1), expected)
    assert np.array_equal(tamis.denoise(**given, threads=3), expected)


def test_other_threads_run_meanwhile():
    color = large(400, 400)
    denoiser = tamis.Denoiser(threads=1)
    denoiser.denoise(color[:32, :32])
    counted, begun, over = 0, threading.Event(), threading.Event()

    def count():
        nonlocal counted
        while not over.is_set():
            counted += 1
            begun.set()
            # Lets go of the interpreter's lock, for whoever wants it.
            time.sleep(0)

    counter = threading.Thread(target=count)
    interval = sys.getswitchinterval()
    try:
        counter.start()
        begun.wait()
        # From here on nobody is asked for the lock: who has it lets go of it, or nobody counts.
        sys.setswitchinterval(1e6)
        before = counted
        denoiser.denoise(color)
        after = counted
    finally:
        sys.setswitchinterval(interval)
        over.set()
        counter.join()
    assert after > before


def test_several_threads_use_one_denoiser(colors):
    given, expected = colors
    denoiser = tamis.Denoiser()
    results = [None] * 4

    def denoise(k):
        results[k] = denoiser.denoise(**given)

    threads = [threading.Thread(target=denoise, args=(k,)) for k in range(len(results))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert all(np.array_equal(result, expected) for result in results)


def test_progress_is_told(tmp_path):
    color = large(400, 300)
    told = []
    caller = threading.get_ident()

    def progress(done, of):
        assert threading.get_ident() == caller
        told.append((done, of))

    tamis.denoise(color, progress=progress)
    assert told[-1] == (400, 400)
    assert all(0 <= done <= of == 400 for done, of in told)
    assert told == sorted(told)


def test_progress_of_files_is_told(scene, tmp_path):
    told = []
    tamis.denoise_file(scene, tmp_path / "clean.exr", progress=lambda done, of: told.append((done, of)))
    assert told and told[-1][0] == told[-1][1] > 0


class Enough(Exception):
    pass


def test_what_progress_raises_ends_the_work():
    color = large()
    out = np.full(color.shape, 7, np.float32)

    def progress(done, of):
        raise Enough

    with pytest.raises(Enough):
        tamis.denoise(color, threads=1, out=out, progress=progress)
    assert (out == 7).all(), "nothing was written"


@pytest.fixture
def interruptible():
    """Ctrl-C raises KeyboardInterrupt. A run in the background is started to ignore it, which
    Python keeps."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.skipif(os.name == "nt", reason="signals are sent by other means there")
def test_ctrl_c_ends_the_work(interruptible):
    color = large()
    out = np.full(color.shape, 7, np.float32)
    rows = []

    def progress(done, of):
        rows.append(done)
        if len(rows) == 1:
            os.kill(os.getpid(), signal.SIGINT)

    with pytest.raises(KeyboardInterrupt):
        tamis.denoise(color, threads=1, out=out, progress=progress)
    assert rows[-1] < len(color) and (out == 7).all()
    assert np.isfinite(tamis.denoise(color[:64, :64])).all(), "it can go on"


@pytest.mark.skipif(os.name == "nt", reason="signals are sent by other means there")
def test_ctrl_c_from_outside_ends_a_process():
    script = """
        import signal, numpy, tamis
        # A run in the background is started to ignore it.
        signal.signal(signal.SIGINT, signal.default_int_handler)
        color = numpy.random.default_rng(1).random((2048, 2048, 3), dtype=numpy.float32)
        denoiser = tamis.Denoiser(threads=1)
        denoiser.denoise(color[:32, :32])
        told = []
        def progress(done, of):
            told.append(done)
            if len(told) == 1:
                print("begun", flush=True)
        try:
            denoiser.denoise(color, progress=progress)
        except KeyboardInterrupt:
            print("interrupted", told[-1] < 2048, flush=True)
    """
    command = [sys.executable, "-c", textwrap.dedent(script)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == "begun\n"
        process.send_signal(signal.SIGINT)
        assert process.stdout.read() == "interrupted True\n"
    assert process.returncode == 0
