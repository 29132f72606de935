"""What every CANopen device needs: SDO access, set-up, settings."""
