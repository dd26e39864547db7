"""The league on valves whose actuator lags, with parameters as an identification finds them."""
