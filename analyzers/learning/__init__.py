"""What runs teach: task times for planners, and the way into a knowledge base."""
