"""What is worked out after the run, one module for each kind of analysis (law 7): from the record alone, repeatable."""
