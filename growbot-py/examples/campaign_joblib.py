"""A campaign with joblib. Chunks are plain functions, and can be merged in any order."""

import joblib

import growbot

SPEC = growbot.CampaignSpec(
    robots=(growbot.Robot(),), goals=((0, 0, 500),), conditions=(growbot.Conditions(noise_percent=10),),
    growths_per_cell=2000,
    growths_per_chunk=500,
)

chunks = joblib.Parallel(n_jobs=2)(joblib.delayed(growbot.run_chunk)(SPEC, chunk) for chunk in range(SPEC.chunk_count))
result = growbot.merge_chunks(SPEC, chunks)
print(
    f"{result.growth_count} simulated growths: {result.summaries[0].position_error_mm['mean']:.3f} mm off in the mean"
)
