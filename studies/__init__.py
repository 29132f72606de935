"""Studies of the model and of the control stack; `make paper` runs those behind docs/paper.md."""
