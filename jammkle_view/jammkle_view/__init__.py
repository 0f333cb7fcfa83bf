"""The page in the browser: the robot in 3D, live or from a bag, with buttons that jam and unjam."""
