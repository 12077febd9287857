"""Stages that move the plate."""
