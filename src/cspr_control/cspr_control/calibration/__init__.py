"""What a recorded run says about the robot itself: parameters that its description lacks."""
