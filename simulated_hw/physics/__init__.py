"""Physics of the virtual bench: functions of state, inputs and elapsed time, exact over any step; never sees bytes."""
