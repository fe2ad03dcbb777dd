"""Blur of scenes without stars: photographs, planets, the ground; from pixels alone or a sharp frame."""
