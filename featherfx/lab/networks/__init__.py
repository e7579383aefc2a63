"""Networks of fibres, and the moduli of a vane that they amount to."""
