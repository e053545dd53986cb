"""How fast is it, and compared with what? One module per question; `make bench` asks them all."""
