"""Objects, states and process data of CANopen, CiA 402 and CiA 404."""
