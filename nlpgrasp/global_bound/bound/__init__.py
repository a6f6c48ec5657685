"""Upper bounds on mu over surface cells, by dual weights of directions."""
