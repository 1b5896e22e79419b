"""A campaign on two local workers of Dask. On a cluster, only the address of the scheduler changes."""

import sys

from distributed import Client, LocalCluster

import growbot

SPEC = growbot.CampaignSpec(
    robots=(growbot.Robot("growbot-a"), growbot.Robot("growbot-a3")),
    goals=((0, 0, 500), (200, 100, 600, 0, 45)),
    conditions=(growbot.Conditions(noise_percent=10), growbot.Conditions(noise_percent=10, sag=True)),
    growths_per_cell=500,
    growths_per_chunk=250,
)


def main() -> None:
    if len(sys.argv) > 1:
        with Client(sys.argv[1]) as client:
            result = growbot.run_campaign(SPEC, client)
    else:
        with (
            LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster,
            Client(cluster) as client,
        ):
            result = growbot.run_campaign(SPEC, client)
    for row in result.table():
        robot, goal, conditions = SPEC.cell(int(row["cell"]))
        sag = "sag" if conditions.sag else "no sag"
        print(f"{robot.name} to {goal}, {sag}: {row['mean_mm']:.2f} mm off in the mean, simulated")


if __name__ == "__main__":
    main()
