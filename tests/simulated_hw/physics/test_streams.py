"""Random streams are functions of seed, name and counter."""

import numpy as np

from simulated_hw.physics.streams import ReadingNoise, Stream


def test_streams_differ_by_seed_and_by_every_name_and_a_name_cannot_be_split_into_two():
    keys = [(1, "a", "b"), (2, "a", "b"), (1, "a", "c"), (1, "ab"), (1, "a"), (12, "a")]
    drawn = {Stream(seed, *names).chunk(0).standard_normal(4).tobytes() for seed, *names in keys}
    assert len(drawn) == len(keys)


def test_chunks_are_independent_of_order_and_of_each_other():
    stream = Stream(7, "x")
    first, second = (stream.chunk(n).standard_normal(100_000) for n in range(2))
    stream.chunk(5).standard_normal(3, dtype=np.float32)  # leaves half a word in the buffer
    assert stream.chunk(1).standard_normal(100_000).tobytes() == second.tobytes()
    assert abs(np.corrcoef(first, second)[0, 1]) < 0.015
    assert not set(first.tolist()) & set(second.tolist())


def test_reading_noise_is_a_function_of_the_time_of_reading():
    one, other = ReadingNoise(Stream(7, "probe"), 0.5), ReadingNoise(Stream(7, "probe"), 0.5)
    times = np.arange(0.0, 400.0, 0.25)
    forwards = [one.at(t) for t in times]
    backwards = [other.at(t) for t in times[::-1]][::-1]
    assert forwards == backwards
    assert forwards[0] == forwards[1] != forwards[2]
    assert abs(np.std(forwards) - 1.0) < 0.06


def test_a_chunk_is_philox_with_its_number_in_the_counters_high_word():
    key = Stream(7, "x")._start["state"]["key"]
    reference = np.random.Generator(np.random.Philox(key=key, counter=[0, 0, 0, 12]))
    assert Stream(7, "x").chunk(12).standard_normal(1000).tobytes() == reference.standard_normal(1000).tobytes()
