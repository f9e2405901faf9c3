"""Wire front ends: simulated instruments speaking real protocols, byte for byte, over sim:// ports and a CAN bus."""
