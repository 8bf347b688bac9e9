"""Tests of `msnn verify`."""
