"""What imported columns need before they can be trusted."""
