"""From a scene to the text of its FreeFEM script."""
