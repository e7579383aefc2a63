"""Networks and membranes of fibres: the moduli that they amount to, how they yield and break."""
