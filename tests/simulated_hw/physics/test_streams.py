"""Random streams are functions of seed, name and counter."""

import numpy as np

from simulated_hw.physics.streams import ReadingNoise, generator, stream_key


def test_streams_differ_by_seed_and_by_every_name_and_a_name_cannot_be_split_into_two():
    keys = [(1, "a", "b"), (2, "a", "b"), (1, "a", "c"), (1, "ab"), (1, "a"), (12, "a")]
    drawn = {generator(stream_key(seed, *names)).standard_normal(4).tobytes() for seed, *names in keys}
    assert len(drawn) == len(keys)


def test_chunks_are_independent_of_order_and_of_each_other():
    key = stream_key(7, "x")
    first, second = generator(key, 0).standard_normal(100_000), generator(key, 1).standard_normal(100_000)
    assert generator(key, 1).standard_normal(100_000).tobytes() == second.tobytes()
    assert abs(np.corrcoef(first, second)[0, 1]) < 0.015
    assert not set(first.tolist()) & set(second.tolist())


def test_reading_noise_is_a_function_of_the_time_of_reading():
    key = stream_key(7, "probe")
    one, other = ReadingNoise(key, 0.5), ReadingNoise(key, 0.5)
    times = np.arange(0.0, 400.0, 0.25)
    forwards = [one.at(t) for t in times]
    backwards = [other.at(t) for t in times[::-1]][::-1]
    assert forwards == backwards
    assert forwards[0] == forwards[1] != forwards[2]
    assert abs(np.std(forwards) - 1.0) < 0.06
