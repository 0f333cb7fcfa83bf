"""What the page shows and how it is drawn. Knows neither ROS nor a browser."""
