"""Jobs handed to other processes: nothing is lost, and long arrays cost no memory."""

from __future__ import annotations

import os
import pickle
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from civil_rgbd.builder.chunks import Job
from civil_rgbd.builder.job_files import JobFiles, write_jobs
from civil_rgbd.builder.plan import PlannedFrames, plan_frames
from civil_rgbd.domain.recipe import Recipe
from civil_rgbd.simulator.recording import SimulatedRecording


@pytest.fixture
def job(recording: SimulatedRecording, recipe: Recipe) -> Job:
    return Job(recording, recipe, plan_frames(recording, recipe).frames, Path("nowhere"))


def frames_without_end(count: int) -> PlannedFrames:
    stamps_ns = np.arange(count, dtype=np.int64)
    return PlannedFrames(stamps_ns, stamps_ns, stamps_ns, np.zeros((count, 4, 4)))


def test_a_job_arrives_as_it_was(job: Job, tmp_path: Path) -> None:
    other = replace(job, partial=Path("elsewhere"), frames=job.frames[:0])
    files: JobFiles = pickle.loads(pickle.dumps(write_jobs([job, other], tmp_path)))  # noqa: S301  # ours

    read = files[0]

    assert files[0] is read
    assert (read.partial, read.recipe) == (job.partial, job.recipe)
    assert [frame.source_index for frame in read.frames] == [f.source_index for f in job.frames]
    for theirs, ours in zip(read.frames, job.frames, strict=True):
        np.testing.assert_array_equal(theirs.T_map_camera, ours.T_map_camera)
    ours_ns, theirs_ns = job.recording.trajectory.stamps_ns, read.recording.trajectory.stamps_ns
    np.testing.assert_array_equal(theirs_ns, ours_ns)
    assert files[1].partial == Path("elsewhere")
    assert len(files[1].frames) == 0


def test_what_a_worker_changes_reaches_no_other(job: Job, tmp_path: Path) -> None:
    files = write_jobs([job], tmp_path)

    files[0].frames.T_map_camera[:] = 0.0

    again = JobFiles(tmp_path)[0]
    np.testing.assert_array_equal(again.frames.T_map_camera, job.frames.T_map_camera)


def test_a_job_without_frames_arrives(job: Job, tmp_path: Path) -> None:
    none = PlannedFrames(*[np.empty(0, dtype=np.int64)] * 3, np.empty((0, 4, 4)))

    assert len(write_jobs([replace(job, frames=none)], tmp_path)[0].frames) == 0


@pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc")
def test_a_long_plan_takes_no_memory_where_nobody_looks(job: Job, tmp_path: Path) -> None:
    long = frames_without_end(200_000)  # 30 MB
    write_jobs([replace(job, frames=long)], tmp_path)
    look = f"""
import re
from pathlib import Path
from civil_rgbd.builder.job_files import JobFiles
def resident_kib():
    return int(re.search(r"VmRSS:\\s+(\\d+)", Path("/proc/self/status").read_text())[1])
files = JobFiles(Path({str(tmp_path)!r}))
import civil_rgbd.simulator.recording
before = resident_kib()
frame = files[0].frames[100_000]
print(frame.source_index, resident_kib() - before)
"""
    told = subprocess.run(
        [sys.executable, "-c", look], capture_output=True, check=True, text=True
    ).stdout.split()

    assert int(told[0]) == 100_000
    assert int(told[1]) < 10_000


@pytest.mark.skipif(sys.platform == "win32", reason="no limit on the size of files there")
def test_a_disk_without_room_is_said_and_nothing_stays(tmp_path: Path) -> None:
    folder = tmp_path / "jobs"
    folder.mkdir()
    code = f"""
import resource, signal
from pathlib import Path
import numpy as np
from civil_rgbd.builder.job_files import write_jobs
from civil_rgbd.errors import OutputError
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))
try:
    write_jobs([np.zeros(10_000)], Path({str(folder)!r}))
except OutputError as error:
    print(error)
"""
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True, text=True)

    assert "cannot write: File too large" in told.stdout
    assert str(folder) in told.stdout
    assert not folder.exists()


@pytest.mark.skipif(sys.platform == "win32", reason="nothing is killed by signals there")
@pytest.mark.parametrize("killed", [False, True])
def test_nothing_stays_in_the_temporary_folder(killed: bool, tmp_path: Path) -> None:  # a case
    temporary, out = tmp_path / "temporary", tmp_path / "out"
    temporary.mkdir()
    script = Path(__file__).with_name("one_build.py")
    build = subprocess.Popen(
        [sys.executable, str(script), str(out), "processes", "2"],
        env=os.environ | {"TMPDIR": str(temporary)},
        stdout=subprocess.DEVNULL,
        start_new_session=True,
    )
    deadline = time.monotonic() + 60
    while killed and not list(out.glob(".partial/B9/done/*.json")):
        assert time.monotonic() < deadline
        time.sleep(0.01)
    if killed:
        build.send_signal(signal.SIGKILL)

    assert (build.wait(timeout=60) != 0) == killed

    while list(temporary.glob("civil_rgbd_*")):  # the workers notice, and clear it away
        assert time.monotonic() < deadline
        time.sleep(0.05)
