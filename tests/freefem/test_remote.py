"""A study on workers that share no disk with the caller, one of which is killed."""

import os
import signal
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from conftest import scene_of

from ffsi.run.sweep import sweep

distributed = pytest.importorskip("distributed")


def test_two_workers_in_separate_folders_give_the_same_table_although_one_is_killed(tmp_path):
    scene = scene_of("flap-svk")
    vary = {"inflow.mean_velocity": np.linspace(0.02, 0.06, 6), "mesh.root_size": ["8 mm", "1 cm"]}
    here = sweep(scene, vary, tmp_path / "here")
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, dashboard_address=None, local_directory=tmp_path / "workers"
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        folders, pids = client.run(os.getcwd), list(client.run(os.getpid).values())
        assert len(set(pids)) == 2 and os.getpid() not in pids and folders

        def kill():
            while not any(client.processing().values()):
                time.sleep(0.01)
            os.kill(pids[0], signal.SIGKILL)

        killer = threading.Thread(target=kill)
        killer.start()
        there = sweep(scene, vary, tmp_path / "there", dask=client)
        killer.join()
    assert there["checked"].all()
    floats = here.select_dtypes("float").columns.difference(["seconds", "check_maximum"])
    assert np.allclose(here[floats], there[floats], rtol=1e-9, atol=1e-12)
    assert {Path(name).name[:6] for name in there["folder"]} == {"chain-"}
